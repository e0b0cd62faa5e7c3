# pyright: basic
"""Whether rollouts lead away from the lethal cells under the footprint."""

from __future__ import annotations

import math

import numpy as np

from navstack.core.footprint_kernels import overlaps_cell
from navstack.core.jit import kernel

BISECTIONS = 40
TURN_STEP = math.radians(5.0)
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
    at the pose, either. 0 for a round robot, whose distance is that of its centre. `placed` (2, n) is scratch.
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


@kernel
def leave_cells(corners, scale, grid, cells, poses, counts, alive, first_nearer, ends_free):
    """Examine the rollouts that are alive: do they keep their distance from the `cells` (m, 2) under the footprint?

    Per row: `first_nearer` (K,) is the first point that comes nearer to a cell, -1 without; `ends_free` (K,) says whether
    the footprint overlaps none of the cells at the last point. `scale`: see `comes_nearer`.
    """
    placed = np.empty(corners.shape)
    for k in range(len(counts)):
        first_nearer[k] = -1
        ends_free[k] = False
        if not alive[k]:
            continue
        for i in range(counts[k]):
            if comes_nearer(corners, scale, poses[k, i], poses[k, 0], grid, cells, placed):
                first_nearer[k] = i
                break
        if first_nearer[k] < 0:
            place_scaled(corners, 1.0, poses[k, counts[k] - 1], grid, placed)
            ends_free[k] = not overlaps_any(placed, cells)


@kernel
def exit_heading(costs, corners, scale, grid, cells, start, reach, reverses):
    """Return the heading (rad) nearest to that of `start` from which a straight motion of up to `reach` (m) leaves the `cells`.

    The turn in place to it and the motion come nearer to none of them and overlap no lethal cell of `costs`, in which the `cells`
    are passable. `reverses`: the motion may be backwards. NaN without such a heading.
    """
    placed = np.empty(corners.shape)
    at = start.copy()
    found = np.empty((1, 2), np.int64)
    step = 0.5 * grid[0].resolution
    open_left, open_right = True, True
    for m in range(math.ceil(math.pi / TURN_STEP) + 1):
        for side in range(2):
            if not (open_left if side == 0 else open_right):
                continue
            at[0], at[1] = start[0], start[1]
            at[2] = start[2] + (m if side == 0 else -m) * TURN_STEP
            place_scaled(corners, 1.0, at, grid, placed)
            free = lethal_cells_under(costs, placed, found) == 0
            if not free or comes_nearer(corners, scale, at, start, grid, cells, placed):
                open_left, open_right = open_left and side == 1, open_right and side == 0
                continue
            for direction in range(2 if reverses else 1):
                sign = 1.0 - 2.0 * direction
                for i in range(1, math.ceil(reach / step) + 1):
                    at[0] = start[0] + sign * i * step * math.cos(at[2])
                    at[1] = start[1] + sign * i * step * math.sin(at[2])
                    if comes_nearer(corners, scale, at, start, grid, cells, placed):
                        break
                    place_scaled(corners, 1.0, at, grid, placed)
                    if lethal_cells_under(costs, placed, found) > 0:
                        break
                    if not overlaps_any(placed, cells):
                        return at[2]
    return np.nan
