"""What all benchmarks share: options, running with progress, tables on stdout, files in a folder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from navstack.cli import options

if TYPE_CHECKING:
    from navstack.bench.table import Table
    from navstack.jobs import Job, JobResult

RESULTS_FILE = "results.jsonl"
_MIN_TABLE_WIDTH = 400

Processes = Annotated[
    int | None,
    typer.Option(
        "--processes",
        metavar="N",
        min=1,
        help="Number of parallel runs; all cores by default. Does not change the results.",
    ),
]


class BenchOutput(NamedTuple):
    """Where the results of a benchmark go."""

    out: Annotated[
        Path | None,
        typer.Option(
            "--out", metavar="DIR", help="Folder for results, tables and pictures.", callback=options.folder_only
        ),
    ] = None
    resume: Annotated[bool, typer.Option("--resume", help="Continue the benchmark whose results are in --out.")] = False
    json_: options.Json = False

    def run(self, task: Any, jobs: Sequence[Job], what: Mapping[str, Any], *, processes: int | None) -> list[JobResult]:
        """Runs the jobs with a progress bar on stderr; the results in the order of the jobs. Raises InputError."""
        from navstack.cli.output import Verbosity, print_note, verbosity
        from navstack.core.errors import InputError
        from navstack.jobs import run_jobs

        if self.resume and self.out is None:
            raise InputError("--resume needs the folder of the earlier results; add --out DIR", argument="--resume")
        shown = verbosity() is not Verbosity.QUIET
        file = self.out / RESULTS_FILE if self.out is not None else None
        try:
            return run_jobs(
                task, jobs, what=what, processes=processes, results=file, resume=self.resume, progress=shown
            )
        except KeyboardInterrupt:
            if file is not None:
                print_note(f"finished runs are saved in {file}; add --resume to continue")
            raise

    def report(
        self,
        document: Mapping[str, Any],
        tables: Sequence[Table],
        results: Sequence[JobResult],
        *,
        files: Mapping[str, Path] | None = None,
        notes: Sequence[str] = (),
    ) -> int:
        """Prints the tables or the document and writes both into `out`; the exit code.

        `document["bench"]` names the files.
        """
        from navstack.bench.table import as_json
        from navstack.cli.output import print_json, print_note

        failed = [r for r in results if r.failed]
        shown = {k: as_json(v) for k, v in document.items()}
        shown["failed"] = [{"job": r.key, "error": r.error} for r in failed]
        shown["notes"] = list(notes)
        written = dict(files or {})
        if self.out is not None:
            written |= self._write(self.out, shown, tables, written)
        if self.json_:
            print_json(shown)
        else:
            print_tables(tables, written)
        for note in notes:
            print_note(note)
        for result in failed:
            assert result.error is not None
            print_note(f"{result.key} gave no result: {result.error['message']}")
        return 1 if failed else 0

    @staticmethod
    def _write(
        folder: Path, document: dict[str, Any], tables: Sequence[Table], files: Mapping[str, Path]
    ) -> dict[str, Path]:
        """Writes the tables as Markdown and the document as JSON; both files."""
        from navstack.core.files import ensure_directory, write_json, write_text

        name = document["bench"]
        written = {"tables": folder / f"{name}.md", "document": folder / f"{name}.json"}
        document["files"] = {k: str(v) for k, v in (*files.items(), *written.items())}
        ensure_directory(folder)
        notes = [f"{note}\n" for note in document["notes"]]
        write_text(written["tables"], "\n".join([*(t.markdown() for t in tables), *notes]))
        write_json(written["document"], document)
        return written


def print_tables(tables: Sequence[Table], files: Mapping[str, Path]) -> None:
    """Prints the tables, then the names of the files, to stdout."""
    from navstack.cli.output import stdout

    for table in tables:
        print_table(table)
    for name, file in files.items():
        stdout().print(f"{name}: {file}", markup=False)


def print_table(table: Table) -> None:
    """Prints a table to stdout."""
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
    # never truncated to the width of the terminal: a truncated number is a wrong number
    Console(width=max(stdout().width, _MIN_TABLE_WIDTH), highlight=False).print(shown)


def whole_numbers(texts: Sequence[str], argument: str) -> list[int]:
    """Integers of `1,7 13` and of repeated options. Raises InputError."""
    from navstack.core.errors import InputError

    found: list[int] = []
    for text in texts:
        for part in text.replace(",", " ").split():
            if not part.isdecimal():
                raise InputError(
                    f'{argument} "{text}": "{part}" is not a whole number; give numbers such as 1,7,13',
                    argument=argument,
                    value=text,
                )
            found.append(int(part))
    return found
