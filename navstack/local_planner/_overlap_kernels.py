# pyright: basic
"""Whether rollouts lead away from the lethal cells under the footprint."""

from __future__ import annotations

import math

import numpy as np

from navstack.core.jit import kernel
from navstack.core.overlap_kernels import comes_nearer, lethal_cells_under, overlaps_any, place_scaled

TURN_STEP = math.radians(5.0)


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
