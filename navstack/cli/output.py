"""What every command prints with: tables on stdout, logs and progress on stderr, JSON alone on stdout."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console

    from navstack.parameters.configuration import Configuration
    from navstack.scenario.run import GoalOutcome


@cache
def stdout() -> Console:
    """Where results go."""
    from rich.console import Console

    return Console(highlight=False, soft_wrap=True)


@cache
def stderr() -> Console:
    """Where everything else goes."""
    from rich.console import Console

    return Console(stderr=True, highlight=False, soft_wrap=True)


def print_error(message: str, hint: str = "") -> None:
    """`error: ..` in red; the way out below it."""
    from rich.markup import escape

    stderr().print(f"[bold red]error:[/] {escape(message)}")
    if hint:
        stderr().print(escape(hint))


def print_note(message: str) -> None:
    """A line for people, on stderr."""
    from rich.markup import escape

    stderr().print(f"[dim]note:[/] {escape(message)}")


def note_warnings(configuration: Configuration) -> None:
    """What `navstack check` warns of, before the parameters are used."""
    for finding in configuration.findings:
        if finding.severity == "warning":
            print_note(f"{finding.location}: {finding.message}")


def reason_of(goal: GoalOutcome, limit_s: float) -> str:
    """Why a goal did not succeed, for people; `limit_s`: the time (s) after which the scenario cancels a goal."""
    over = goal.state == "PREEMPTED" and goal.time_s >= limit_s
    limit = f"; its time limit of {limit_s:g} s was over" if over else ""
    return f"{goal.error_name} ({goal.error_code}): {goal.message}{limit}"


def print_json(document: Mapping[str, Any]) -> None:
    """One JSON document on stdout; what is not finite becomes null."""
    from navstack.core.errors import jsonable

    json.dump(jsonable(dict(document)), sys.stdout, allow_nan=False)
    sys.stdout.write("\n")


@contextmanager
def loading_kernels(*, quiet: bool = False) -> Generator[None]:
    """Says on stderr what keeps the user waiting: the kernels are loaded or, the first time, compiled.

    Where there is no terminal the status would not show: the long wait is then said in a line, also with `quiet`.
    """
    from navstack.core.jit import kernels_are_cached
    from navstack.global_planner._kernels import wave
    from navstack.sim._lidar_kernels import sweep

    cached = kernels_are_cached(sweep, wave)
    what = "loading the kernels" if cached else "compiling the kernels, this first time only: about half a minute"
    if not cached and (quiet or not stderr().is_terminal):
        print_note(what)
    if quiet:
        yield
    else:
        with stderr().status(what):
            yield


@contextmanager
def counting_bar(what: str, *, quiet: bool) -> Generator[Callable[[int, int], None]]:
    """A progress bar on stderr, headed `what`, for something that says how much of it is done: `progress(done, total)`."""
    from rich.progress import Progress

    with Progress(console=stderr(), transient=True, disable=quiet or not stderr().is_terminal) as bar:
        task = bar.add_task(what, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)
