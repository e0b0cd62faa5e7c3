"""How far the jobs are and how long they will take, on stderr: a bar on a terminal, a line now and then elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import Final

from navstack.jobs.job import JobResult

LINES_APART_S: Final = 60.0
"""Where there is no terminal, a line says this often (s) how far it is."""


@contextmanager
def progress_of(total: int, done: int, *, quiet: bool) -> Generator[Callable[[JobResult], None]]:
    """Gives what is to be called with each result; `done` of `total` are there already."""
    if quiet:
        yield lambda result: None
    elif sys.stderr.isatty():
        with time_left_bar(total, done) as move:
            failed = 0

            def told(result: JobResult) -> None:
                nonlocal done, failed
                done += 1
                failed += result.failed
                move(done, f"{failed} failed" if failed else "")

            yield told
    else:
        yield _lines(total, done)


@contextmanager
def time_left_bar(
    total: int, done: int = 0, *, what: str = "", shown: bool = True
) -> Generator[Callable[[int, str], None]]:
    """A bar on stderr with the time taken and left, headed `what`; nothing where it is not `shown`.

    Gives what is to be called with how many of `total` are done by now and a remark to stand behind the bar.
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
    said, now_done = began, done

    def told(result: JobResult) -> None:
        nonlocal said, now_done
        now_done += 1
        now = time.monotonic()
        if now - said >= LINES_APART_S:
            said = now
            left = (now - began) / (now_done - done) * (total - now_done)
            print(f"{now_done} of {total} done, {left / 60.0:.1f} min left", file=sys.stderr, flush=True)

    return told
