"""Interrupts: Ctrl-C, a terminated session and a closed terminal end a run in good order."""

from __future__ import annotations

import signal
import threading
from collections.abc import Generator
from contextlib import contextmanager
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
