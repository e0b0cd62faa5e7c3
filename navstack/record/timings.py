"""Wall times of planning and control on this machine; they are not part of the record."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, ParamSpec, TypeVar

import numpy as np

P = ParamSpec("P")
T = TypeVar("T")


@dataclass(slots=True)
class Timings:
    """Seconds of each call of the planners, by default of the wall clock; they vary from run to run."""

    planning_s: list[float] = field(default_factory=list[float])
    """Calls of the global planner, failed ones included."""
    control_s: list[float] = field(default_factory=list[float])
    """Calls of the local planner."""
    clock: Callable[[], float] = time.perf_counter
    """Clock in seconds; `time.thread_time` counts processor time."""

    def as_dict(self) -> dict[str, Any]:
        """Returns JSON data: for each kind the count and the 50th, 95th and 99th percentile and maximum in ms."""
        return {"planning_ms": _percentiles(self.planning_s), "control_ms": _percentiles(self.control_s)}


def timed(
    function: Callable[P, T], into: list[float], clock: Callable[[], float] = time.perf_counter
) -> Callable[P, T]:
    """Wraps `function`: appends the seconds of each call to `into`, also if it raises."""

    def call(*args: P.args, **kwargs: P.kwargs) -> T:
        begin = clock()
        try:
            return function(*args, **kwargs)
        finally:
            into.append(clock() - begin)

    return call


def _percentiles(seconds: list[float]) -> dict[str, float]:
    if not seconds:
        return {"count": 0}
    p50, p95, p99 = (1e3 * np.percentile(seconds, (50, 95, 99))).tolist()
    return {"count": len(seconds), "p50": p50, "p95": p95, "p99": p99, "max": 1e3 * max(seconds)}
