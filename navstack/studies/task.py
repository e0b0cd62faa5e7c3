"""Many runs are one pipe: a task names its jobs, executors run them, and the task puts their results into tables."""

from __future__ import annotations

import math
import sys
import time
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, Final

from navstack.core import InternalError
from navstack.studies.executors import ProcessExecutor
from navstack.studies.jobs import Executor, Job, JobResult, Work
from navstack.studies.results_file import ResultsFile
from navstack.studies.table import Table


@dataclass(frozen=True, slots=True)
class Report:
    """What the results of a task say."""

    tables: Sequence[Table]
    """To show, in order."""
    document: Mapping[str, Any]
    """For JSON, in addition to `Task.described`: tables, rows, single runs."""
    notes: Sequence[str] = ()
    """What to consider when reading the tables."""
    passed: bool = True
    """False if the results show a fault, such as a violated invariant."""


class Task(ABC):
    """A kind of many runs: a benchmark or a comparison. Calling it performs one job, in any process; it must be picklable."""

    @abstractmethod
    def described(self) -> dict[str, Any]:
        """Return everything that affects the results, except what the jobs' keys say; `bench` names the files."""

    @abstractmethod
    def jobs(self) -> list[Job]:
        """Return the jobs, in the same order each time. Raises InputError for unknown names."""

    @abstractmethod
    def __call__(self, job_input: Any, /) -> Any:
        """Perform the job with this input; return JSON data. A pure function of task and input, except for times."""

    @abstractmethod
    def report(self, results: Sequence[JobResult]) -> Report:
        """Put the results of `jobs`, in their order, into tables."""

    def draw(self, report: Report, folder: Path) -> dict[str, Path]:
        """Draw the report's pictures into a folder; return their files by name."""
        del report, folder
        return {}

    def finished(self, results: Sequence[JobResult]) -> Iterator[tuple[Any, Any]]:
        """Yield input and value of every job that gave a result."""
        for result, job in zip(results, self.jobs(), strict=True):
            if not result.failed:
                yield job.input, result.value


def run_jobs(
    work: Work,
    jobs: Sequence[Job],
    *,
    what: Mapping[str, Any] | None = None,
    processes: int | None = None,
    executor: Executor | None = None,
    results: Path | None = None,
    resume: bool = False,
    progress: bool = False,
    on_result: Callable[[JobResult], None] | None = None,
) -> list[JobResult]:
    """Run `work` on the input of every job; returns the results in the order of the jobs.

    `processes`: number of workers (default: all usable cores); or an `executor` created for the same work, which is closed at the
    end. `results`: a file that stores each result immediately, so that `resume` continues an interrupted run; `what` (JSON data)
    describes the inputs other than the jobs' keys, and a file with another description is rejected. `progress`: shows a bar on
    stderr. `on_result` is called with each new result.

    A job that raises, or whose worker dies twice, has an error result; the other jobs continue. Raises InputError and
    OutputError for a results file that cannot be used; after a KeyboardInterrupt the file can be resumed.
    """
    keys = [job.key for job in jobs]
    with ExitStack() as stack:
        if executor is not None:
            stack.callback(executor.close)
        duplicates = [key for key, count in Counter(keys).items() if count > 1]
        if duplicates:
            raise InternalError(f"two jobs have the key {duplicates[0]!r}")
        file = None
        if results is not None:
            file = stack.enter_context(ResultsFile(results, what or {}, keys, resume=resume))
        found = dict(file.done) if file is not None else {}
        left = [job for job in jobs if job.key not in found]
        report = stack.enter_context(progress_of(jobs, list(found), quiet=not progress))
        if left:
            if executor is None:
                executor = ProcessExecutor(work, processes)
                stack.callback(executor.close)
            queue = iter(left)
            for job in islice(queue, executor.slots):
                executor.submit(job)
            for _ in left:
                result = executor.collect()
                # submit first: the worker runs while the line is written
                for job in islice(queue, 1):
                    executor.submit(job)
                found[result.key] = result
                if file is not None:
                    file.add(result)
                if on_result is not None:
                    on_result(result)
                report(result)
        ordered = [found[key] for key in keys]
        if file is not None:
            file.put_in_order(ordered)
        return ordered


# --- progress ---------------------------------------------------------------------------------------------------------

LINE_INTERVAL_S: Final = 60.0
"""Interval of the progress lines without a terminal (s)."""


@contextmanager
def progress_of(jobs: Sequence[Job], done: Sequence[str], *, quiet: bool) -> Generator[Callable[[JobResult], None]]:
    """Yield a callback for each result; the jobs with the keys `done` are finished. Jobs count by their weight."""
    weights = {job.key: job.weight for job in jobs}
    finished = math.fsum(weights[key] for key in done)
    if quiet:
        yield lambda result: None
    elif sys.stderr.isatty():
        counted = all(weight == 1.0 for weight in weights.values())
        with time_left_bar(math.fsum(weights.values()), finished, counted=counted) as move:
            failed = 0
            left = [job.key for job in jobs if job.key not in done]

            def report(result: JobResult) -> None:
                nonlocal finished, failed
                finished += weights[result.key]
                failed += result.failed
                left.remove(result.key)
                remarks = [f"{failed} failed"] if failed else []
                move(finished, "; ".join([*remarks, *left[:1]]))

            move(finished, left[0] if left else "")
            yield report
    else:
        yield _lines(weights, finished, len(done))


@contextmanager
def time_left_bar(
    total: float, done: float = 0, *, what: str = "", shown: bool = True, counted: bool = True
) -> Generator[Callable[[float, str], None]]:
    """Show a bar on stderr with the elapsed and the remaining time, labeled `what`, if `shown`.

    `counted`: the items count alike and are shown as numbers, otherwise as a percentage.
    Yields a callback that takes the number of finished items and a remark shown behind the bar.
    """
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (
        *((TextColumn(what),) if what else ()),
        MofNCompleteColumn() if counted else TextColumn("{task.percentage:3.0f} %"),
        BarColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(elapsed_when_finished=False),
        TextColumn("{task.fields[remark]}"),
    )
    bar = Progress(
        *columns, console=Console(stderr=True), transient=True, speed_estimate_period=600.0, disable=not shown
    )
    with bar:
        task = bar.add_task("", total=total, completed=int(done), remark="")
        yield lambda now_done, remark: bar.update(task, completed=now_done, remark=remark)


def _lines(weights: Mapping[str, float], finished: float, count: int) -> Callable[[JobResult], None]:
    began = time.monotonic()
    last_line, now_finished, now_count = began, finished, count
    total = math.fsum(weights.values())

    def report(result: JobResult) -> None:
        nonlocal last_line, now_finished, now_count
        now_finished += weights[result.key]
        now_count += 1
        now = time.monotonic()
        if now - last_line >= LINE_INTERVAL_S:
            last_line = now
            left = (now - began) / (now_finished - finished) * (total - now_finished)
            print(f"{now_count} of {len(weights)} done, {left / 60.0:.1f} min left", file=sys.stderr, flush=True)

    return report
