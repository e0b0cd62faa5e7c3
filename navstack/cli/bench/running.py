"""What all benches share: options, running with progress, tables on stdout, files in a folder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from navstack.bench.table import Table
    from navstack.jobs import Job, JobResult

RESULTS_FILE = "results.jsonl"
_WIDEST = 400

PARAMS_HELP = "A packaged set, a folder, or files in order (repeat)."
PROCESSES: Any = typer.Option(
    None,
    "--processes",
    metavar="N",
    min=1,
    help="How many runs at once; all cores unless given. The results are the same.",
)
OUT: Any = typer.Option(None, "--out", metavar="DIR", help="Keep results, tables and pictures there.")
RESUME: Any = typer.Option(False, "--resume", help="Go on with what --out holds.")
JSON: Any = typer.Option(False, "--json", help="One JSON document on stdout.")


def run(
    work: Any,
    jobs: Sequence[Job],
    what: Mapping[str, Any],
    *,
    processes: int | None,
    out: Path | None,
    resume: bool,
) -> list[JobResult]:
    """Runs the jobs with a bar on stderr. Raises InputError."""
    from navstack.cli.output import print_note
    from navstack.core.errors import InputError
    from navstack.jobs import run_jobs

    if resume and out is None:
        raise InputError("--resume: say with --out where the results are that it goes on with", argument="--resume")
    file = out / RESULTS_FILE if out is not None else None
    try:
        return run_jobs(work, jobs, what=what, processes=processes, results=file, resume=resume, progress=True)
    except KeyboardInterrupt:
        if file is not None:
            print_note(f"what is done is kept in {file}; --resume goes on with it")
        raise


def report(
    document: Mapping[str, Any],
    tables: Sequence[Table],
    *,
    failed: Sequence[JobResult] = (),
    files: Mapping[str, Path] | None = None,
    notes: Sequence[str] = (),
    out: Path | None,
    name: str,
    json_: bool,
) -> int:
    """Prints the tables or the document, writes both into `out`; the exit code."""
    from navstack.bench.table import as_json
    from navstack.cli.output import print_json, print_note, stdout
    from navstack.core.files import ensure_directory, write_json, write_text

    told = {k: as_json(v) for k, v in document.items()}
    told["failed"] = [{"job": r.key, "error": r.error} for r in failed]
    told["notes"] = list(notes)
    kept = dict(files or {})
    if out is not None:
        kept |= {"tables": out / f"{name}.md", "document": out / f"{name}.json"}
        told["files"] = {k: str(v) for k, v in kept.items()}
        ensure_directory(out)
        text = "\n".join([*(t.markdown() for t in tables), *(f"{note}\n" for note in notes)])
        write_text(kept["tables"], text)
        write_json(kept["document"], told)
    if json_:
        print_json(told)
    else:
        for table in tables:
            print_table(table)
        for what, file in kept.items():
            stdout().print(f"{what}: {file}", markup=False)
    for note in notes:
        print_note(note)
    for result in failed:
        assert result.error is not None
        print_note(f"{result.key} gave no result: {result.error['message']}")
    return 1 if failed else 0


def print_table(table: Table) -> None:
    """A table on stdout."""
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table as RichTable

    from navstack.cli.output import stdout

    shown = RichTable(title=escape(table.title), title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
    for i, column in enumerate(table.columns):
        shown.add_column(escape(column.head), justify="right" if table.is_numeric(i) else "left", no_wrap=True)
    for row in table.texts():
        shown.add_row(*(escape(cell) for cell in row))
    # never cut to the width of a terminal: a number without its end is another number
    Console(width=max(stdout().width, _WIDEST), highlight=False).print(shown)


def whole_numbers(texts: Sequence[str], argument: str) -> list[int]:
    """`1,7 13` and repeated options -> whole numbers. Raises InputError."""
    from navstack.core.errors import InputError

    found: list[int] = []
    for text in texts:
        for part in text.replace(",", " ").split():
            if not part.isdecimal():
                raise InputError(
                    f'{argument} "{text}": "{part}" is no whole number; give numbers such as 1,7,13',
                    argument=argument,
                    value=text,
                )
            found.append(int(part))
    return found
