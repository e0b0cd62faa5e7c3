"""Time and peak memory of one call, and the watch over processes that read inputs."""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

_CLEAR: Final = Path("/proc/self/clear_refs")
_ADDRESS_SPACE: Final = 8_000_000_000
"""Limit of a process that reads inputs: protects the machine; what is counted as too large is far below."""


def peak_bytes() -> int:
    """Return the peak of this process's resident memory since the last `reset_peak`, or since its start."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024


def reset_peak() -> None:
    """Set the peak to the current size (Linux; elsewhere the peak only grows, so a growth is counted once)."""
    try:
        with _CLEAR.open("wb", buffering=0) as file:
            file.write(b"5")
    except OSError:
        return


def limit_address_space() -> None:
    """Limit the memory that this process can ask for."""
    hard = resource.getrlimit(resource.RLIMIT_AS)[1]
    limit = _ADDRESS_SPACE if hard == resource.RLIM_INFINITY else min(hard, _ADDRESS_SPACE)
    resource.setrlimit(resource.RLIMIT_AS, (limit, hard))


def queued_seconds(process: int | None = None) -> float:
    """Return how long a process (default: this thread) has waited for a processor that others used (s).

    0 where the system does not say.
    """
    task = "thread-self" if process is None else str(process)
    try:
        return int(Path(f"/proc/{task}/schedstat").read_bytes().split()[1]) * 1e-9
    except (OSError, ValueError, IndexError):
        return 0.0


def measured(call: Callable[[], object]) -> tuple[float, float, int, Exception | None]:
    """Return the wall time (s), the part without waiting for the processor (s), the growth of memory (bytes), the exception.

    The growth is that of the peak of the resident memory.
    """
    reset_peak()
    before, failure = peak_bytes(), None
    queued, started = queued_seconds(), time.perf_counter()
    try:
        call()
    except Exception as exc:
        failure = exc
    wall = time.perf_counter() - started
    return wall, max(0.0, wall - (queued_seconds() - queued)), peak_bytes() - before, failure
