"""Interrupts: Ctrl-C, a terminated session and a closed terminal end a run in good order."""

from __future__ import annotations

import contextlib
import json
import os
import platform
import shlex
import signal
import sys
import tempfile
import threading
import traceback
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Final

_NAMES: Final = ("SIGINT", "SIGTERM", "SIGHUP")


class Interrupt:
    """The signal that asked the command to stop, if any."""

    def __init__(self) -> None:
        self.signal: int | None = None

    def __call__(self) -> bool:
        """Returns True after the first signal."""
        return self.signal is not None

    @property
    def exit_code(self) -> int:
        """128 + the number of the signal, as of a shell: 130 for Ctrl-C, 143 for SIGTERM, 129 for SIGHUP."""
        return 128 + (self.signal or signal.SIGINT)


@contextmanager
def raised_terminations() -> Generator[Interrupt]:
    """SIGTERM and SIGHUP end a command as Ctrl-C does, so that it removes files that it has begun: by KeyboardInterrupt.

    Yields an object that holds the signal. A second signal of the kind ends the process at once. Handlers of others and
    ignored signals (nohup) stay.
    """
    flag = Interrupt()
    if threading.current_thread() is not threading.main_thread():
        yield flag
        return
    numbers = [number for name in _NAMES[1:] if (number := getattr(signal, name, None)) is not None]
    replaced = [number for number in numbers if signal.getsignal(number) is signal.SIG_DFL]

    def handle(number: int, frame: FrameType | None) -> None:
        del frame
        flag.signal = number
        signal.signal(number, signal.SIG_DFL)
        raise KeyboardInterrupt

    for number in replaced:
        signal.signal(number, handle)
    try:
        yield flag
    finally:
        for number in replaced:
            signal.signal(number, signal.SIG_DFL)


@contextmanager
def interrupt_flag() -> Generator[Interrupt]:
    """Yields an object that is True after SIGINT, SIGTERM or SIGHUP; a second signal of the kind ends the command at once.

    It does so by KeyboardInterrupt or SystemExit, so that the terminal is restored and begun files are removed. A third one
    ends a process that does not get there.
    """
    flag = Interrupt()
    if threading.current_thread() is not threading.main_thread():  # signals are only received there
        yield flag
        return
    before = {number: signal.getsignal(number) for name in _NAMES if (number := getattr(signal, name, None))}

    def handle(number: int, frame: FrameType | None) -> None:
        del frame
        flag.signal = flag.signal or number
        signal.signal(number, signal.default_int_handler if number == signal.SIGINT else leave)

    def leave(number: int, frame: FrameType | None) -> None:
        del frame
        signal.signal(number, signal.SIG_DFL)
        raise SystemExit(128 + number)

    for number, handler in before.items():
        # nohup ignores SIGHUP, and a background job of a shell SIGINT: that stays so
        if handler is not signal.SIG_IGN:
            signal.signal(number, handle)
    try:
        yield flag
    finally:
        for number, handler in before.items():
            if handler is not None:
                signal.signal(number, handler)


# ----------------------------------------------------------------------------------------------------------------------
# The last resort: an exception that no command expects becomes one message; its traceback goes to a file.


EXIT_INTERNAL: Final = 70
"""EX_SOFTWARE of sysexits.h."""
_show = False


def show_traceback(shown: bool) -> None:
    """Sets whether tracebacks are printed instead of written to a file (`--debug`, NAVSTACK_DEBUG=1)."""
    global _show
    _show = shown


def report(exc: Exception, arguments: Sequence[str]) -> int:
    """Reports a defect of navstack to the user; returns the exit code."""
    text = "".join(traceback.format_exception(exc))
    command = shlex.join(["navstack", *arguments])
    where = f"{type(exc).__name__}: {_first_line(exc)}"
    if _show:
        _print(text)
        details = "the traceback is above"
    else:
        file = _write(f"{command}\n{_versions()}\n\n{text}")
        details = f"the traceback is in {file}" if file is not None else "--debug prints the traceback"
    message = (
        f"internal error: {where}. This is a defect of navstack, not of your input; {details}. Please report it to the "
        "maintainers of navstack with this file and, if possible, the input files"
    )
    if "--json" in arguments:
        error = {"code": 9099, "name": "INTERNAL", "message": message, "exception": where}
        with contextlib.suppress(OSError, ValueError):
            print(json.dumps({"error": error}), flush=True)
    else:
        _print(f"error: {message}")
    return EXIT_INTERNAL


def _first_line(exc: Exception) -> str:
    try:
        text = " ".join(str(exc).split())
    except Exception:  # an exception whose text cannot be made
        return "(no text)"
    return text if len(text) <= 200 else f"{text[:197]}..."


def _versions() -> str:
    from navstack import __version__

    return f"navstack {__version__}, Python {platform.python_version()}, {platform.platform()}"


def _write(text: str) -> Path | None:
    """Writes the report to a new file of the system's folder for temporary files; None if that is impossible."""
    try:
        number, name = tempfile.mkstemp(prefix="navstack_error_", suffix=".txt")
        with os.fdopen(number, "w", encoding="utf-8", errors="backslashreplace") as file:
            file.write(text)
    except OSError:
        return None
    return Path(name)


def _print(text: str) -> None:
    with contextlib.suppress(OSError, ValueError):
        print(text, file=sys.stderr, flush=True)
