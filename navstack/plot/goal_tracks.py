"""The data of the picture of goals over time. Times in s of the run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Bar:
    """A time span: a state or a recovery."""

    label: str
    begin: float
    end: float
    failed: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class GoalTrack:
    """The data of one goal."""

    label: str
    begin: float
    end: float
    outcome: str
    """Terminal state: SUCCEEDED, ABORTED, .."""
    states: Sequence[Bar]
    recoveries: Sequence[Bar]
    plans: Sequence[float]
    """Times of the plans found."""
    failed_plans: Sequence[float]
    failed_commands: Sequence[float]
    times: NDArray[np.float64]
    """(n,)"""
    distance: NDArray[np.float64]
    """(n,) straight-line distance to the goal (m)."""
    remaining: NDArray[np.float64]
    """(n,) remaining length of the plan (m); NaN without a plan."""
    velocity: NDArray[np.float64]
    """(n, 3) vx, vy (m/s), wz (rad/s)."""

    @property
    def is_drawable(self) -> bool:
        """False for a goal without control cycles, which was cancelled or replaced before it began."""
        return len(self.times) > 0 and math.isfinite(self.end)
