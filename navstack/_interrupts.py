"""Ctrl-C while the command `navstack` starts: Python would print a traceback of what it is importing."""

from __future__ import annotations

import os
import signal
import sys
from types import FrameType


def is_command() -> bool:
    """Return whether this process is the command `navstack`, not a program that imports the package."""
    arguments = sys.orig_argv
    script = os.path.basename(arguments[1]) if len(arguments) > 1 else ""  # noqa: PTH119 - pathlib takes its time to import
    return script in ("navstack", "navstack.exe") or arguments[1:3] == ["-m", "navstack"]


def end_quietly() -> None:
    """Let Ctrl-C end the process at once, without an exception."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _leave)


def raise_again() -> None:
    """Let Ctrl-C raise KeyboardInterrupt again: from now on it is caught."""
    if signal.getsignal(signal.SIGINT) is _leave:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _leave(number: int, frame: FrameType | None) -> None:
    del number, frame
    os.write(2, b"interrupted\n")
    os._exit(130)
