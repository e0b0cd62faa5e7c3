"""Compares the commands and plans of a replay with those in the log."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import Twist2D

LINEAR_M_S: Final = 0.05
"""Commands differ if their translational velocities differ by more (m/s),"""
ANGULAR_RAD_S: Final = 0.1
"""or their rotational velocities by more (rad/s)."""


class Cycle(NamedTuple):
    """One cycle of a replay."""

    time: float
    state: str
    """State of the goal manager."""
    goal: int
    """Index of the active goal, -1 without one."""
    command: Twist2D
    """The command of navstack."""
    recorded: Twist2D | None
    """The newest command in the log; None before the first one."""
    rejected: bool
    """True if the local planner found no valid command."""
    controlled: bool
    """True if the local planner found a command."""
    planned: bool
    """True if a new global plan arrived."""


class Difference(NamedTuple):
    """A cycle in which the commands differ."""

    time: float
    command: Twist2D
    recorded: Twist2D


class CommandComparison(NamedTuple):
    """Commands of navstack and of the log, over the cycles in which navstack had a command and the log had one."""

    cycles: int
    """Number of compared cycles."""
    different: int
    """Number of cycles in which they differ by more than `LINEAR_M_S` or `ANGULAR_RAD_S`."""
    equal: int
    """Number of cycles in which they are equal to the bit."""
    first: Difference | None
    """The first difference."""
    mean_linear: float
    """Mean difference of the translational velocity (m/s)."""
    mean_angular: float
    """Mean difference of the rotational velocity (rad/s)."""
    opposite: int
    """Number of cycles in which one drives forward and the other backward, or they turn in opposite directions."""

    def as_dict(self) -> dict[str, Any]:
        """Return the comparison for JSON."""
        first = self.first
        return {
            "cycles": self.cycles,
            "different": self.different,
            "equal": self.equal,
            "opposite": self.opposite,
            "mean_linear_m_s": self.mean_linear,
            "mean_angular_rad_s": self.mean_angular,
            "first": None
            if first is None
            else {"time": first.time, "command": list(first.command), "recorded": list(first.recorded)},
        }


def compare_commands(cycles: Sequence[Cycle]) -> CommandComparison | None:
    """Compare the commands; None if the log has none while a goal was active."""
    pairs = [(cycle, cycle.recorded) for cycle in cycles if cycle.controlled and cycle.recorded is not None]
    if not pairs:
        return None
    ours = np.array([cycle.command for cycle, _ in pairs], np.float64)
    theirs = np.array([recorded for _, recorded in pairs], np.float64)
    linear = np.hypot(*(ours - theirs)[:, :2].T)
    angular = np.abs(ours[:, 2] - theirs[:, 2])
    differs = (linear > LINEAR_M_S) | (angular > ANGULAR_RAD_S)
    opposite = _opposite(ours[:, 0], theirs[:, 0], LINEAR_M_S) | _opposite(ours[:, 2], theirs[:, 2], ANGULAR_RAD_S)
    index = int(np.argmax(differs)) if differs.any() else -1
    first = None
    if index >= 0:
        cycle, recorded = pairs[index]
        first = Difference(cycle.time, cycle.command, recorded)
    return CommandComparison(
        len(pairs),
        int(differs.sum()),
        int((ours == theirs).all(axis=1).sum()),
        first,
        float(linear.mean()),
        float(angular.mean()),
        int(opposite.sum()),
    )


def _opposite(a: NDArray[np.float64], b: NDArray[np.float64], threshold: float) -> NDArray[np.bool_]:
    return (a * b < 0.0) & (np.abs(a) > threshold) & (np.abs(b) > threshold)


class PlanComparison(NamedTuple):
    """Plans of navstack and of the log for the same time."""

    plans: int
    """Number of compared pairs."""
    length: float
    """Mean length of navstack's plans (m)."""
    recorded_length: float
    """Mean length of the log's plans (m)."""
    deviation: float
    """Mean over the pairs of the largest distance (m) of a pose of navstack's plan from the log's plan."""
    largest: float
    """The largest of these distances (m)."""
    largest_at: float
    """Time of the largest distance (s)."""

    def as_dict(self) -> dict[str, Any]:
        """Return the comparison for JSON."""
        return {
            "plans": self.plans,
            "mean_length_m": self.length,
            "recorded_mean_length_m": self.recorded_length,
            "mean_deviation_m": self.deviation,
            "largest_deviation_m": self.largest,
            "largest_deviation_at_s": self.largest_at,
        }


def compare_plans(
    ours: Sequence[tuple[float, NDArray[np.float64]]],
    recorded: Sequence[tuple[float, NDArray[np.float64]]],
    within_s: float = 1.0,
) -> PlanComparison | None:
    """Compare each plan in the log, (time, poses (n, 3)) in the same frame, with navstack's nearest in time.

    None if there is no pair within `within_s` (s).
    """
    times = np.array([t for t, _ in ours])
    rows: list[tuple[float, float, float, float]] = []
    for t, poses in recorded:
        if not len(times) or len(poses) < 2:
            continue
        index = int(np.argmin(np.abs(times - t)))
        if abs(times[index] - t) <= within_s and len(ours[index][1]) >= 2:
            mine = ours[index][1]
            rows.append((t, _length(mine), _length(poses), _farthest(mine, poses)))
    if not rows:
        return None
    table = np.array(rows)
    worst = int(np.argmax(table[:, 3]))
    length, recorded_length, deviation = table[:, 1:].mean(axis=0).tolist()
    largest, at = float(table[worst, 3]), float(table[worst, 0])
    return PlanComparison(len(rows), length, recorded_length, deviation, largest, at)


def _length(poses: NDArray[np.float64]) -> float:
    return float(np.hypot(*np.diff(poses[:, :2], axis=0).T).sum())


def _farthest(poses: NDArray[np.float64], line: NDArray[np.float64]) -> float:
    """Return the largest distance (m) of a pose from the polyline `line`."""
    import shapely

    distances = shapely.distance(shapely.points(poses[:, :2]), shapely.LineString(line[:, :2]))
    return float(np.max(distances))
