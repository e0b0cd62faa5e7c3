# pyright: basic
"""Lethal cells under a footprint, and whether a pose is nearer to them than another one."""

from __future__ import annotations

import math

import numpy as np

from navstack.core.footprint_kernels import overlaps_cell
from navstack.core.jit import kernel

BISECTIONS = 40
ROUNDING = 1e-9
"""Cells: what a comparison of two distances may be off by rounding."""


@kernel
def place_scaled(corners, scale, pose, grid, placed):
    """Write the scaled corners (2, n) at a pose (m, m, rad) to `placed` (2, n), in cells. `grid` (1,): see `grid_record`."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for j in range(corners.shape[1]):
        vx, vy = scale * corners[0, j], scale * corners[1, j]
        placed[0, j] = (pose[0] + (vx * c - vy * s) - grid[0].origin_x) / grid[0].resolution
        placed[1, j] = (pose[1] + (vx * s + vy * c) - grid[0].origin_y) / grid[0].resolution


@kernel
def overlaps_any(placed, cells):
    """Return True if the polygon `placed` (2, n), in cells, overlaps one of the `cells` (m, 2) ix, iy."""
    found = False
    for j in range(len(cells)):
        found = found or overlaps_cell(placed, cells[j, 0], cells[j, 1])
    return found


@kernel
def lethal_cells_under(costs, placed, cells):
    """Write ix, iy of the lethal cells that a polygon overlaps to `cells` (m, 2); return their number.

    `placed` (2, n): the corners in cells; parts outside the grid are ignored. At most m cells are written.
    """
    ny, nx = costs.shape
    found = 0
    low_x, high_x = max(0, math.floor(placed[0].min())), min(nx - 1, math.floor(placed[0].max()))
    low_y, high_y = max(0, math.floor(placed[1].min())), min(ny - 1, math.floor(placed[1].max()))
    for iy in range(low_y, high_y + 1):
        for ix in range(low_x, high_x + 1):
            if costs[iy, ix] == 254 and overlaps_cell(placed, ix, iy):
                if found < len(cells):
                    cells[found, 0], cells[found, 1] = ix, iy
                found += 1
    return found


@kernel
def nearest_distance(x, y, cells):
    """Return the distance from a point (in cells) to the nearest of the `cells` (m, 2)."""
    nearest = np.inf
    for j in range(len(cells)):
        to_x = min(max(x, np.float64(cells[j, 0])), cells[j, 0] + 1.0)
        to_y = min(max(y, np.float64(cells[j, 1])), cells[j, 1] + 1.0)
        nearest = min(nearest, math.hypot(to_x - x, to_y - y))
    return nearest


@kernel
def free_scale(corners, pose, grid, cells):
    """Return the largest scale of a footprint, up to 1, at which it overlaps none of the `cells` at a pose; 0 without one."""
    placed = np.empty(corners.shape)
    low, high = 0.0, 1.0
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        place_scaled(corners, middle, pose, grid, placed)
        if overlaps_any(placed, cells):
            high = middle
        else:
            low = middle
    return low


@kernel
def comes_nearer(corners, scale, pose, start, grid, cells, placed):
    """Return True if the robot is nearer to one of the `cells` (m, 2) at `pose` than at `start`.

    `scale`: of the part of the footprint that overlaps none of the cells at the start (`free_scale`), which must not overlap one
    at the pose, either. 0 for a round robot, whose distance is that of its center. `placed` (2, n) is scratch.
    """
    if scale > 0.0:
        place_scaled(corners, scale, pose, grid, placed)
        return overlaps_any(placed, cells)
    before = nearest_distance(
        (start[0] - grid[0].origin_x) / grid[0].resolution, (start[1] - grid[0].origin_y) / grid[0].resolution, cells
    )
    now = nearest_distance(
        (pose[0] - grid[0].origin_x) / grid[0].resolution, (pose[1] - grid[0].origin_y) / grid[0].resolution, cells
    )
    return now < before - ROUNDING
