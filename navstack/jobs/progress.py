"""Progress of jobs on stderr: a bar on a terminal, otherwise a line per minute."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import Final

from navstack.jobs.job import JobResult

LINE_INTERVAL_S: Final = 60.0
"""Interval of the progress lines without a terminal (s)."""


@contextmanager
def progress_of(total: int, done: int, *, quiet: bool) -> Generator[Callable[[JobResult], None]]:
    """Yields a callback for each result; `done` of `total` results exist already."""
    if quiet:
        yield lambda result: None
    elif sys.stderr.isatty():
        with time_left_bar(total, done) as move:
            failed = 0

            def report(result: JobResult) -> None:
                nonlocal done, failed
                done += 1
                failed += result.failed
                move(done, f"{failed} failed" if failed else "")

            yield report
    else:
        yield _lines(total, done)


@contextmanager
def time_left_bar(
    total: int, done: int = 0, *, what: str = "", shown: bool = True
) -> Generator[Callable[[int, str], None]]:
    """Shows a bar on stderr with the elapsed and the remaining time, labelled `what`, if `shown`.

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
        MofNCompleteColumn(),
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
        task = bar.add_task("", total=total, completed=done, remark="")
        yield lambda now_done, remark: bar.update(task, completed=now_done, remark=remark)


def _lines(total: int, done: int) -> Callable[[JobResult], None]:
    began = time.monotonic()
    last_line, now_done = began, done

    def report(result: JobResult) -> None:
        nonlocal last_line, now_done
        now_done += 1
        now = time.monotonic()
        if now - last_line >= LINE_INTERVAL_S:
            last_line = now
            left = (now - began) / (now_done - done) * (total - now_done)
            print(f"{now_done} of {total} done, {left / 60.0:.1f} min left", file=sys.stderr, flush=True)

    return report
