"""Measurements of a run per control cycle, from which its metrics are computed."""

from __future__ import annotations

import math
from array import array
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.record.metrics import RunMetrics, compute_metrics
from navstack.sim import SimulatedRobot


class RunMeasurements:
    """Collects pose, state and clearance at each control cycle.

    Clearances are computed on request, or when an obstacle has moved: one call for many poses is faster.
    """

    def __init__(self, robot: SimulatedRobot, *, keep: bool = True) -> None:
        """`keep=False` measures the path length only."""
        self._keep = keep
        self._robot = robot
        self._rows = array("d")
        self._states: list[str] = []
        self._clearances = array("d")
        self._solids = robot.solids
        """The obstacles during the cycles whose clearance has not been computed yet."""
        self._last_pose = robot.pose
        self.path_length = 0.0
        """Sum of the distances between consecutive cycles' poses (m); excludes slip within a cycle."""

    def add(self, state: str) -> None:
        """Records the current cycle."""
        robot = self._robot
        pose = robot.pose
        self.path_length += pose.distance_to(self._last_pose)
        self._last_pose = pose
        if not self._keep:
            return
        if robot.solids is not self._solids:
            self._compute_clearances()
            self._solids = robot.solids
        self._rows.extend((robot.time, *pose))
        self._states.append(state)

    def clearances(self) -> array[float]:
        """Returns the clearance at each cycle (m)."""
        self._compute_clearances()
        return self._clearances

    def min_clearance(self) -> float:
        """Returns the minimum clearance over all cycles (m)."""
        return min(self.clearances(), default=math.inf)

    def track(self) -> NDArray[np.float64]:
        """Returns (n, 4) time (s) and true pose (m, m, rad) at each cycle."""
        return np.array(self._rows, np.float64).reshape(-1, 4)

    def metrics(self, results: Sequence[Mapping[str, Any]]) -> RunMetrics:
        """Computes the metrics of the cycles so far; `results` are those of the goals."""
        rows = self.track()
        return compute_metrics(
            rows[:, 0],
            rows[:, 1:4],
            self._states,
            np.array(self.clearances(), np.float64),
            results=results,
            collisions=len(self._robot.collisions),
        )

    def _compute_clearances(self) -> None:
        first = len(self._clearances)
        if first < len(self._states):
            poses = np.array(self._rows[4 * first :], np.float64).reshape(-1, 4)[:, 1:].copy()
            self._clearances.extend(self._robot.clearances(poses, self._solids).tolist())
