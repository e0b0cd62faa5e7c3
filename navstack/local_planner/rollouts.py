"""The cells of the points of trajectories, shared by the critics of one cycle."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from navstack.core.errors import InputError
from navstack.core.grid import GridGeometry
from navstack.interfaces import Rollouts, ScoringContext
from navstack.local_planner._rollout_kernels import point_cells

MAX_POINTS = 20_000_000
"""More points a cycle than this (about half a gigabyte) is a mistake in the granularities or the limits."""


def check_points(samples: int, longest: int) -> None:
    """Raises InputError when a cycle would simulate more points than memory should hold."""
    if samples * longest > MAX_POINTS:
        raise InputError(
            f"{samples} trajectories of up to {longest} points are too many to simulate in a cycle; raise sim_granularity "
            "or angular_sim_granularity, or lower sim_time or the numbers of samples",
            samples=samples,
            points=longest,
        )


class RolloutCells:
    """Cells of K trajectories of at most T points, in memory that is kept from cycle to cycle."""

    def __init__(self) -> None:
        self._memory = np.empty((2, 0), np.int32)
        self._poses: NDArray[np.float64] | None = None
        self._geometry: GridGeometry | None = None
        self.flat: NDArray[np.int32] = np.empty((0, 0), np.int32)
        """(K, T) `iy * nx + ix`; -1 off the map."""
        self.ringed: NDArray[np.int32] = np.empty((0, 0), np.int32)
        """(K, T) the same in a grid with a ring of one cell around it (`MapGrid.distances`)."""
        self.boxes: NDArray[np.int32] = np.empty((0, 4), np.int32)
        """(K, 4) lowest ix, iy and highest ix, iy of a row's points; the lowest are negative where one is off the map."""

    def forget(self) -> None:
        """A new cycle: what was computed counts no more."""
        self._poses = None

    def compute(self, rollouts: Rollouts, geometry: GridGeometry) -> RolloutCells:
        """Itself, of these trajectories; computed once until `forget`."""
        if self._poses is rollouts.poses and self._geometry is geometry:
            return self
        k, t = rollouts.poses.shape[:2]
        if self._memory.shape[1] < k * t:
            self._memory = np.empty((2, k * t), np.int32)
        if len(self.boxes) != k:
            self.boxes = np.empty((k, 4), np.int32)
        self.flat, self.ringed = (part[: k * t].reshape(k, t) for part in self._memory)
        g = geometry
        self.box = point_cells(
            rollouts.poses,
            rollouts.counts,
            g.nx,
            g.ny,
            g.origin_x,
            g.origin_y,
            g.resolution,
            self.flat,
            self.ringed,
            self.boxes,
        )
        self._poses, self._geometry = rollouts.poses, g
        return self


def shared_cells(context: ScoringContext, rollouts: Rollouts) -> RolloutCells:
    """The cells of `rollouts`: computed for the first critic that asks, used by the others."""
    cells: RolloutCells | None = context.shared.get("cells")
    if cells is None:
        cells = context.shared["cells"] = RolloutCells()
    return cells.compute(rollouts, context.costmap.geometry)
