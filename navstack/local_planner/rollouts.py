# pyright: basic
"""What local planners need in addition to their own simulation: size checks, single points, and the cells of rollouts."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from navstack.core import InputError, plain_kernel
from navstack.plugins import RolloutCells, Rollouts, ScoringContext

MAX_POINTS = 5_000_000
"""More points per cycle (about half a second of work) indicate a mistake in the granularities or the limits."""


def check_samples(numbers: Mapping[str, int]) -> None:
    """Raise ValueError if the numbers of samples of each axis, by parameter, multiply to more than `MAX_POINTS` samples."""
    samples = math.prod(numbers.values())
    if samples > MAX_POINTS:
        product = " * ".join(f"{name} {number:,}" for name, number in numbers.items())
        raise ValueError(
            f"{product} make {samples:,} trajectories in a cycle; lower the numbers to at most {MAX_POINTS:,} in total (usual "
            "are some hundred)"
        )


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


def shared_cells(context: ScoringContext, rollouts: Rollouts) -> RolloutCells:
    """Cells of `rollouts`: computed for the first critic that needs them, then shared."""
    cells = context.cells
    if cells is None or cells.poses is not rollouts.poses:
        k, t = rollouts.poses.shape[:2]
        both, boxes = np.empty((2, k, t), np.int32), np.empty((k + 1, 4), np.int32)
        cells = context.cells = RolloutCells(both[0], both[1], boxes, rollouts.poses)
        scratch = np.empty((2, t))
        point_cells(rollouts.poses, rollouts.counts, context.grid, cells.flat, cells.padded, boxes, scratch)
    return cells


@plain_kernel
def point_cells(poses, counts, grid, cells, padded, boxes, scratch):
    """Write the cells of all points to `cells` and `padded` (K, T) int32; -1 off the map.

    `cells`: flat index in the costmap. `padded`: flat index in a grid with a border of one cell. `grid`: see `grid_record`.
    `boxes` (K + 1, 4) int32: lowest ix, iy and highest ix, iy of each row's points. The lowest are -1 where a point is off
    the map; a row without points gets nx, ny, -1, -1. The last row is the half-open box around all points, clipped to the
    map: x0, y0, x1, y1; empty without points. `scratch` (2, T).
    """
    nx, ny = grid[0].nx, grid[0].ny
    origin_x, origin_y, resolution = grid[0].origin_x, grid[0].origin_y, grid[0].resolution
    columns, width, one = np.int32(nx), np.int32(nx + 2), np.int32(1)
    x0, y0, x1, y1 = nx, ny, np.int64(0), np.int64(0)
    xs, ys = scratch[0], scratch[1]
    for k in range(len(counts)):
        low_x, low_y, high_x, high_y = np.int32(nx), np.int32(ny), np.int32(-1), np.int32(-1)
        row, padded_row = cells[k], padded[k]
        number = np.uint64(counts[k])
        for i in range(number):
            xs[i], ys[i] = poses[k, i, 0], poses[k, i, 1]
        for i in range(number):
            fx, fy = (xs[i] - origin_x) / resolution, (ys[i] - origin_y) / resolution
            # branchless, in contiguous arrays and in 32 bits, so that the loop is vectorized; NaN counts as off the map
            inside = (fx >= 0.0) & (fy >= 0.0) & (fx < nx) & (fy < ny)
            ix = np.int32(fx if inside else -1.0)
            iy = np.int32(fy if inside else -1.0)
            row[i] = iy * columns + ix if inside else -one
            padded_row[i] = (iy + one) * width + ix + one if inside else -one
            low_x, high_x = min(low_x, ix), max(high_x, ix)
            low_y, high_y = min(low_y, iy), max(high_y, iy)
        boxes[k, 0] = low_x
        boxes[k, 1] = low_y
        boxes[k, 2] = high_x
        boxes[k, 3] = high_y
        x0, y0 = min(x0, max(low_x, 0)), min(y0, max(low_y, 0))
        x1, y1 = max(x1, high_x + 1), max(y1, high_y + 1)
    last = len(counts)
    boxes[last, 0] = x0
    boxes[last, 1] = y0
    boxes[last, 2] = x1
    boxes[last, 3] = y1
