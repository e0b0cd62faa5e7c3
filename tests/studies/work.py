"""Work functions for the tests; workers import them by name."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from typing import Any

from navstack.core import NoValidPathError


def double(number: float) -> dict[str, float]:
    return {"twice": 2 * number, "third": number / 3.0, "nothing": float("nan")}


def blocks_interrupts(number: int) -> bool:
    del number
    return signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, ())


def fail(number: int) -> int:
    if number == 1:
        raise NoValidPathError("no way from 1", cells=7)
    if number == 2:
        raise ZeroDivisionError("by hand")
    return number


def die_once(asked: tuple[str, int]) -> int:
    """Kills its process at the first call with number 3."""
    folder, number = asked
    seen = Path(folder) / "died"
    if number == 3 and not seen.exists():
        seen.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def die(number: int) -> int:
    if number == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def surroundings(name: str) -> list[Any]:
    print("to stderr")
    return [str(Path.cwd()), os.environ.get(name)]


class Counting:
    """Keeps state: the number of jobs that the worker has run."""

    def __init__(self) -> None:
        self.done = 0

    def __call__(self, _: int) -> int:
        self.done += 1
        return self.done


def wait_for(file: str) -> str:
    """Ends when the file can be read; blocks forever on a pipe without a writer."""
    Path(f"{file}.pid").write_text(str(os.getpid()))
    return Path(file).read_text()
