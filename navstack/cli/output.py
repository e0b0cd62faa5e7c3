"""Output of all commands: results on stdout, notes and progress on stderr; with --json one document on stdout."""

from __future__ import annotations

import json
import shlex
import signal
import sys
import threading
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, nullcontext
from enum import IntEnum
from functools import cache
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from rich.console import Console

    from navstack.parameters import Configuration, Finding
    from navstack.scenario import GoalOutcome


class Verbosity(IntEnum):
    """How much is written to stderr; results and errors always are."""

    QUIET = -1
    """No notes, warnings and progress."""
    NORMAL = 0
    VERBOSE = 1
    """Also the notes about parameters (`info`), the duration of the command, and the traceback of an internal error."""


_verbosity = Verbosity.NORMAL
_compiling_noted = False
"""True once the note about compilation has been printed: once per command is enough."""
COMPILING: Final = "compiling kernels, once per machine; about half a minute on two free cores"


def set_verbosity(verbosity: Verbosity) -> None:
    """Sets how much the commands of this process write to stderr; each command begins with it."""
    global _verbosity, _compiling_noted
    _verbosity, _compiling_noted = verbosity, False


def verbosity() -> Verbosity:
    """How much the commands of this process write to stderr."""
    return _verbosity


@cache
def stdout() -> Console:
    """Console for results."""
    from rich.console import Console

    return Console(highlight=False, soft_wrap=True)


@cache
def stderr() -> Console:
    """Console for notes, errors and progress."""
    from rich.console import Console

    return Console(stderr=True, highlight=False, soft_wrap=True)


def print_error(message: str, hint: str = "") -> None:
    """Prints `error: MESSAGE` to stderr, and the hint on a line of its own."""
    from rich.markup import escape

    stderr().print(f"[bold red]error:[/] {escape(message)}")
    if hint:
        stderr().print(escape(hint))


def print_note(message: str) -> None:
    """Prints `note: MESSAGE` to stderr, except with --quiet."""
    from rich.markup import escape

    if _verbosity >= Verbosity.NORMAL:
        stderr().print(f"[dim]note:[/] {escape(message)}")


def print_warnings(
    configuration: Configuration,
    sources: Sequence[str] = (),
    overrides: Sequence[str] = (),
    *,
    distro: str | None = None,
    simulated: bool = False,
) -> None:
    """Print the warnings about the parameters of these sources to stderr; see `print_findings`.

    `simulated`: a robot is simulated, so a sensor that is assumed is noted.
    """
    print_findings(configuration.findings, sources, overrides, distro=distro)
    if simulated and _verbosity == Verbosity.NORMAL:
        for assumed in [f for f in configuration.findings if f.rule == "assumed-lidar"][:1]:
            print_note(assumed.message)


def print_findings(
    findings: Sequence[Finding],
    sources: Sequence[str] = (),
    overrides: Sequence[str] = (),
    *,
    distro: str | None = None,
) -> None:
    """Print warnings to stderr, with the severity that `navstack check` uses: none with --quiet, also infos with --verbose.

    Several warnings about named `sources` are one line with the command that shows them, except with --verbose.
    """
    from rich.markup import escape

    shown = {Verbosity.QUIET: (), Verbosity.NORMAL: ("warning",), Verbosity.VERBOSE: ("warning", "info")}[_verbosity]
    chosen = [finding for finding in findings if finding.severity in shown]
    # `check` has no option --footprint or --compare: what is said about their values is printed
    counted = [f for f in chosen if not f.file.startswith("--") or f.file.startswith("--set")]
    if _verbosity == Verbosity.NORMAL and len(counted) > 1 and sources:
        options = [word for text in overrides for word in ("--set", text)] + (["--distro", distro] if distro else [])
        command = shlex.join(["navstack", "check", *sources, *options])
        stderr().print(f"[yellow]{len(counted)} warnings about the parameters;[/] `{escape(command)}` shows them")
        chosen = [f for f in chosen if f not in counted]
    for finding in chosen:
        color = "yellow" if finding.severity == "warning" else "cyan"
        place = f"{finding.location}: " if str(finding.location) else ""
        stderr().print(f"[{color}]{finding.severity}:[/] {escape(f'{place}{finding.message}')}")


def print_files(files: Mapping[str, str]) -> None:
    """Prints the names of written files, one per line."""
    for what, name in files.items():
        stdout().print(f"{what}: {name}", markup=False)


def titled_table(title: str, *, left: Sequence[str] = (), right: Sequence[str] = ()) -> Any:
    """A rich table with left-aligned columns, then right-aligned ones."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
    for name in left:
        table.add_column(name, no_wrap=True)
    for name in right:
        table.add_column(name, justify="right", no_wrap=True)
    return table


def reason_of(goal: GoalOutcome) -> str:
    """Why a goal did not succeed. The status text of C++ says less than the message, so it is left out."""
    return f"{goal.error_name} ({goal.error_code}): {goal.message}"


def print_advice(advice: Sequence[str]) -> None:
    """Prints what may explain missed goals or long turns in place, and what to try."""
    from rich.markup import escape

    for text in advice:
        stdout().print(f"[yellow]possible cause:[/] {escape(text)}")


def counted(count: int, noun: str) -> str:
    """Return `1 collision` or `2 collisions`."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def print_json(document: Mapping[str, Any]) -> None:
    """Prints one JSON document to stdout; NaN and infinity become null."""
    from navstack.core import jsonable

    json.dump(jsonable(dict(document)), sys.stdout, allow_nan=False)
    sys.stdout.write("\n")


@contextmanager
def loading_kernels(
    uses: Sequence[str] = (), *, quiet: bool = False, progress: Callable[[int, int], None] | None = None
) -> Generator[None]:
    """Compiles the kernels of these plugins ahead, and shows a status on stderr while kernels are loaded or compiled.

    Compilation is long, so it is also announced, by a note, with `quiet` or without a terminal.
    `progress` is that of `compile_kernels`.
    """
    from navstack.core import compilation_reported

    announced = compile_kernels(uses, quiet=quiet, progress=progress) > 0
    status = None if quiet or _verbosity < Verbosity.NORMAL else stderr().status("loading the kernels")

    def announce() -> None:
        if status is not None and stderr().is_terminal:
            status.update(COMPILING)
        elif not announced:
            _note_compiling()

    with status or nullcontext(), compilation_reported(announce):
        yield


def compile_kernels(
    uses: Sequence[str] | None,
    *,
    quiet: bool = False,
    progress: Callable[[int, int], None] | None = None,
    required: bool = False,
) -> int:
    """Compiles the missing kernels of these uses (None: all) in parallel; shows a bar, or a note without a terminal.

    `progress(done, total)` is called as well; `required` as in `compile_ahead`. Returns the number of specializations that
    were missing.
    """
    from navstack.core import compile_ahead

    with _interruptible(), ExitStack() as opened:
        update: Callable[[int, int], None] | None = None

        def show(done: int, total: int) -> None:
            nonlocal update
            if update is None and shows_progress(quiet=quiet):
                update = opened.enter_context(counting_bar("compiling kernels, once per machine", quiet=quiet))
            elif update is None:
                _note_compiling()
                update = _shows_nothing
            update(done, total)
            if progress is not None:
                progress(done, total)

        return compile_ahead(uses, show, required=required)


def _note_compiling() -> None:
    global _compiling_noted
    if not _compiling_noted:
        print_note(COMPILING)
    _compiling_noted = True


def _shows_nothing(done: int, total: int) -> None:
    del done, total


@contextmanager
def _interruptible() -> Generator[None]:
    """Lets Ctrl-C raise KeyboardInterrupt also where a command notes it for later: nothing has begun."""
    before = signal.getsignal(signal.SIGINT)
    if before in (None, signal.SIG_IGN) or threading.current_thread() is not threading.main_thread():
        yield
        return
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def shows_progress(*, quiet: bool = False) -> bool:
    """True if progress is shown: on a terminal, without `quiet` and --quiet."""
    return not quiet and _verbosity >= Verbosity.NORMAL and stderr().is_terminal


@contextmanager
def counting_bar(what: str, *, quiet: bool) -> Generator[Callable[[int, int], None]]:
    """A progress bar on stderr, labeled `what`; yields its callback `progress(done, total)`."""
    from rich.progress import Progress

    with Progress(console=stderr(), transient=True, disable=not shows_progress(quiet=quiet)) as bar:
        task = bar.add_task(what, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)
