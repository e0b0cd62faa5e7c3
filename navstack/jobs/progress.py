"""How far the jobs are and how long they will take, on stderr: a bar on a terminal, a line now and then elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager

from navstack.jobs.job import JobResult

_LINES_APART_S = 60.0


@contextmanager
def progress_of(total: int, done: int, *, quiet: bool) -> Generator[Callable[[JobResult], None]]:
    """Gives what is to be called with each result; `done` of `total` are there already."""
    if quiet:
        yield lambda result: None
    elif sys.stderr.isatty():
        with _bar(total, done) as told:
            yield told
    else:
        yield _lines(total, done)


@contextmanager
def _bar(total: int, done: int) -> Generator[Callable[[JobResult], None]]:
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
        MofNCompleteColumn(),
        BarColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(elapsed_when_finished=False),
        TextColumn("{task.fields[failed]}"),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True, speed_estimate_period=600.0) as bar:
        task = bar.add_task("", total=total, completed=done, failed="")
        failed = 0

        def told(result: JobResult) -> None:
            nonlocal failed
            failed += result.failed
            bar.update(task, advance=1, failed=f"{failed} failed" if failed else "")

        yield told


def _lines(total: int, done: int) -> Callable[[JobResult], None]:
    began = time.monotonic()
    said, now_done = began, done

    def told(result: JobResult) -> None:
        nonlocal said, now_done
        now_done += 1
        now = time.monotonic()
        if now - said >= _LINES_APART_S:
            said = now
            left = (now - began) / (now_done - done) * (total - now_done)
            print(f"{now_done} of {total} done, {left / 60.0:.1f} min left", file=sys.stderr, flush=True)

    return told
