"""The wall time that a thread has spent compiling kernels: what a measured time of a first run must not contain."""

from __future__ import annotations

import threading
import time
from collections.abc import Generator
from contextlib import contextmanager
from typing import Final


class _CompileClock(threading.local):
    """Seconds of compilation in this thread, and how deep it is in nested compilations."""

    depth = 0
    seconds = 0.0


_CLOCK: Final = _CompileClock()


@contextmanager
def compiling() -> Generator[None]:
    """Count the time of the block as compilation; a block within another one counts once."""
    begin = time.perf_counter()
    _CLOCK.depth += 1
    try:
        yield
    finally:
        _CLOCK.depth -= 1
        if not _CLOCK.depth:
            _CLOCK.seconds += time.perf_counter() - begin


def compile_seconds() -> float:
    """Return the wall time (s) that this thread has spent compiling kernels, or loading compiled ones.

    The difference of two values is what a measured time contains of it: each kernel is compiled at its first call.
    """
    return _CLOCK.seconds


def working_time() -> float:
    """Return a clock (s) that stands while this thread compiles kernels: for times that a second run reaches, too."""
    return time.perf_counter() - _CLOCK.seconds
