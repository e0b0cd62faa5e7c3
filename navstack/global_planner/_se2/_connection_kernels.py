# pyright: basic
"""Whether any way for the footprint connects two cells, at whatever headings. Coordinates are in cells."""

from __future__ import annotations

import math

import numpy as np

from navstack.core.jit import plain_kernel
from navstack.global_planner._se2._heuristic_kernels import obstacle_cost
from navstack.global_planner._se2._shape_kernels import centre_cost, near_obstacles, outline_blocked

PARTS = 3
"""Parts of a cell along each side, and of the range of a heading."""


@plain_kernel
def part_of_cell(costs, bits, shape, p, cell, yaw, width):
    """Return how many checks it takes to find a part of a cell, and of a range of headings, in which the footprint may fit.

    `yaw`, `width`: middle and width of the range. More than PARTS ** 3: there is none.
    """
    nx = costs.shape[1]
    middle = PARTS // 2
    for k in range(PARTS**3):
        # the middle of the cell first
        at = (k + PARTS**3 // 2) % PARTS**3
        i, j, turn = at % PARTS - middle, at // PARTS % PARTS - middle, at // PARTS**2 - middle
        x, y, heading = cell % nx + 0.5 + i / PARTS, cell // nx + 0.5 + j / PARTS, yaw + turn * width / PARTS
        if not outline_blocked(costs, bits, shape, 1, p, x, y, math.cos(heading), math.sin(heading)):
            return k + 1
    return PARTS**3 + 1


@plain_kernel
def heading_in_cell(costs, bits, shape, p, cell, headings, first):
    """Return (heading, checks): one at which the footprint may fit with its centre in a cell, -1 where it fits at none.

    `shape`: `Shape.rows` of smaller footprints. Where that of level 0 is blocked at the middle of the cell and a heading, the
    footprint is blocked all over the cell and up to the headings beside it; where that of level 1 is, in a part of them; where
    that of level 2 is, all over the cell at every heading.
    `first`: the heading that is tried first.
    """
    nx = costs.shape[1]
    x, y = cell % nx + 0.5, cell // nx + 0.5
    if centre_cost(costs, p, x, y) < 0:
        return -1, 0
    if p.corners == 0 or not near_obstacles(costs, bits, p, x - 0.5, y - 0.5, x + 0.5, y + 0.5):
        return first, 0
    if outline_blocked(costs, bits, shape, 2, p, x, y, 1.0, 0.0):
        return -1, 1
    width, checks = 2.0 * math.pi / headings, 1
    for k in range(headings):
        # the nearest ones first: + 1, - 1, + 2, ..
        heading = (first + ((k + 1) // 2 if k % 2 == 1 else -(k // 2))) % headings
        yaw = heading * width
        checks += 1
        if not outline_blocked(costs, bits, shape, 0, p, x, y, math.cos(yaw), math.sin(yaw)):
            tried = part_of_cell(costs, bits, shape, p, cell, yaw, width)
            checks += tried
            if tried <= PARTS**3:
                return heading, checks
    return -1, checks


@plain_kernel
def may_connect(costs, bits, shape, field, front, p, seen, lists, ends, headings, most):
    """Return False if no cells in which the footprint may fit connect a cell with the surroundings of the goal.

    A search along the obstacle heuristic; True as well after `most` checks of the footprint. `seen` (ny * nx): zeros; `lists`:
    heads of buckets, -1, and the next cell of each cell (ny * nx); `ends`: cell of the start, goal, and distance from it that
    suffices.
    """
    ny, nx = costs.shape
    start, goal_x, goal_y, near = ends
    heads, after = lists
    last = len(heads) - 1
    width = 2.0 * max(1.0, obstacle_cost(costs, field, front, p, start % nx, start // nx)) / len(heads)
    heads[last], after[start], seen[start] = start, -1, 1
    lowest, checks = last, 0
    while lowest <= last:
        cell = np.int64(heads[lowest])
        if cell < 0:
            lowest += 1
            continue
        heads[lowest] = after[cell]
        cx, cy, heading = cell % nx, cell // nx, np.int64(seen[cell]) - 1
        if math.hypot(cx + 0.5 - goal_x, cy + 0.5 - goal_y) <= near:
            return True
        if cell != start:
            heading, tried = heading_in_cell(costs, bits, shape, p, cell, headings, heading)
            checks += tried
            if checks > most:
                return True
            if heading < 0:
                continue
        for k in range(9):
            ix, iy = cx + k % 3 - 1, cy + k // 3 - 1
            other = iy * nx + ix
            if ix < 0 or iy < 0 or ix >= nx or iy >= ny or seen[other] != 0:
                continue
            seen[other] = heading + 1
            left = obstacle_cost(costs, field, front, p, ix, iy)
            if left < np.inf:
                bucket = min(np.int64(left / width), last)
                after[other] = heads[bucket]
                heads[bucket] = other
                lowest = min(lowest, bucket)
    return False
