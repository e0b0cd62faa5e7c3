"""What local planners need beside their own simulation: size checks, single points, and the cells of rollouts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from navstack.core.errors import InputError
from navstack.core.grid import GridGeometry, grid_record
from navstack.interfaces import RolloutCells, Rollouts, ScoringContext
from navstack.local_planner._rollout_kernels import point_cells

MAX_POINTS = 20_000_000
"""More points per cycle (about half a gigabyte) indicate a mistake in the granularities or the limits."""


def check_points(samples: int, longest: int) -> None:
    """Raise InputError if `samples` rollouts of up to `longest` points exceed MAX_POINTS."""
    if samples * longest > MAX_POINTS:
        raise InputError(
            f"{samples} trajectories of up to {longest} points are too many to simulate in a cycle; raise sim_granularity "
            "or angular_sim_granularity, or lower sim_time or the numbers of samples",
            samples=samples,
            points=longest,
        )


def single_points(rollouts: Rollouts, point: int | NDArray[np.int64]) -> Rollouts:
    """The same rollouts reduced to one point each."""
    rows = np.arange(len(rollouts.counts))
    poses = np.ascontiguousarray(rollouts.poses[rows, point][:, None, :])
    return Rollouts(rollouts.commands, poses, np.minimum(rollouts.counts, 1), rollouts.alive)


def compute_cells(rollouts: Rollouts, geometry: GridGeometry) -> RolloutCells:
    """Cells of all points of `rollouts` in a grid."""
    k, t = rollouts.poses.shape[:2]
    cells = RolloutCells(
        np.empty((k, t), np.int32), np.empty((k, t), np.int32), np.empty((k + 1, 4), np.int32), rollouts.poses
    )
    point_cells(rollouts.poses, rollouts.counts, grid_record(geometry), cells.flat, cells.padded, cells.boxes)
    return cells


def shared_cells(context: ScoringContext, rollouts: Rollouts) -> RolloutCells:
    """Cells of `rollouts`: computed for the first critic that needs them, then shared."""
    if context.cells is None or context.cells.poses is not rollouts.poses:
        context.cells = compute_cells(rollouts, context.costmap.geometry)
    return context.cells
