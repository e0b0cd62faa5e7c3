"""What all benchmarks share: options, running with progress, tables on stdout, files in a folder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from navstack.cli import options
from navstack.cli.output import Verbosity, print_json, print_note, stdout, verbosity
from navstack.core import InputError, ensure_directory, write_json, write_text
from navstack.studies import as_json, run_jobs

if TYPE_CHECKING:
    from navstack.studies import JobResult, Report, Table, Task

RESULTS_FILE = "results.jsonl"

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

    def carry_out(self, task: Task, *, processes: int | None) -> int:
        """Run the jobs of a task with a progress bar on stderr; print its report, or write it into `out`, too.

        Return the exit code: 1 if a job gave no result, or if the report shows a fault. Raises InputError.
        """
        return self.reported(task, processes=processes)[0]

    def reported(self, task: Task, *, processes: int | None) -> tuple[int, Report]:
        """Do as `carry_out`; return the exit code and the report."""
        results = self._run(task, processes)
        report = task.report(results)
        files = task.draw(report, self.out) if self.out is not None else {}
        document = {**task.described(), **report.document}
        code = self._show(document, report, results, files)
        return code or int(not report.passed), report

    def _run(self, task: Task, processes: int | None) -> list[JobResult]:
        """The results of all jobs, in their order."""
        if self.resume and self.out is None:
            raise InputError("--resume needs the folder of the earlier results; add --out DIR", argument="--resume")
        shown = verbosity() is not Verbosity.QUIET
        file = self.out / RESULTS_FILE if self.out is not None else None
        jobs = task.jobs()  # first: its messages name what is missing
        what = task.described()
        try:
            return run_jobs(
                task, jobs, what=what, processes=processes, results=file, resume=self.resume, progress=shown
            )
        except KeyboardInterrupt:
            if file is not None:
                print_note(f"finished runs are saved in {file}; add --resume to continue")
            raise

    def _show(
        self, document: Mapping[str, Any], report: Report, results: Sequence[JobResult], files: Mapping[str, Path]
    ) -> int:
        """Print the tables or the document and write both into `out`; the exit code. `document["bench"]` names the files."""
        failed = [r for r in results if r.failed]
        shown = {k: as_json(v) for k, v in document.items()}
        shown["failed"] = [{"job": r.key, "error": r.error} for r in failed]
        shown["notes"] = list(report.notes)
        written = dict(files)
        if self.out is not None:
            written |= self._write(self.out, shown, report.tables, written)
        if self.json_:
            print_json(shown)
        else:
            for table in report.tables:
                table.print(stdout())
            for name, file in written.items():
                stdout().print(f"{name}: {file}", markup=False)
        for note in report.notes:
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
        name = document["bench"]
        written = {"tables": folder / f"{name}.md", "document": folder / f"{name}.json"}
        document["files"] = {k: str(v) for k, v in (*files.items(), *written.items())}
        ensure_directory(folder)
        notes = [f"{note}\n" for note in document["notes"]]
        write_text(written["tables"], "\n".join([*(t.markdown() for t in tables), *notes]))
        write_json(written["document"], document)
        return written


def whole_numbers(texts: Sequence[str], argument: str) -> list[int]:
    """Integers of `1,7 13` and of repeated options. Raises InputError."""
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
