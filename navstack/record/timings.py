"""How long planning and control took on this machine: wall times, which no record holds."""

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
    """Wall seconds of each call of a planner; they differ from run to run."""

    planning_s: list[float] = field(default_factory=list[float])
    """Of the global planner, plans that were not found included."""
    control_s: list[float] = field(default_factory=list[float])
    """Of the local planner's commands."""

    def as_dict(self) -> dict[str, Any]:
        """For JSON: of each kind how many, and the 50th, 95th and 99th percentile and the longest in ms."""
        return {"planning_ms": _percentiles(self.planning_s), "control_ms": _percentiles(self.control_s)}


def timed(function: Callable[P, T], into: list[float]) -> Callable[P, T]:
    """`function`, which adds the wall seconds of each call to `into`, also when it raises."""

    def call(*args: P.args, **kwargs: P.kwargs) -> T:
        begin = time.perf_counter()
        try:
            return function(*args, **kwargs)
        finally:
            into.append(time.perf_counter() - begin)

    return call


def _percentiles(seconds: list[float]) -> dict[str, float]:
    if not seconds:
        return {"count": 0}
    p50, p95, p99 = (1e3 * np.percentile(seconds, (50, 95, 99))).tolist()
    return {"count": len(seconds), "p50": p50, "p95": p95, "p99": p99, "max": 1e3 * max(seconds)}
