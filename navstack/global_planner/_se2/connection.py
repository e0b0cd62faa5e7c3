"""Early proof that no path exists: the footprint fits in no cell, at no heading, on any way between start and goal."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from navstack.core import plain_kernel
from navstack.global_planner._se2.heuristics import obstacle_cost
from navstack.global_planner._se2.records import untouched_zeros
from navstack.global_planner._se2.search import Pose
from navstack.global_planner._se2.shape import Shape, center_cost, near_obstacles, outline_blocked

# ----------------------------------------------------------------------------------------------------------------------
# Whether any way for the footprint connects two cells, at whatever headings. Coordinates are in cells.


# pyright: basic


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
    """Return (heading, checks): one at which the footprint may fit with its center in a cell, -1 where it fits at none.

    `shape`: `Shape.rows` of smaller footprints. Where that of level 0 is blocked at the middle of the cell and a heading, the
    footprint is blocked all over the cell and up to the headings next to it; where that of level 1 is, in a part of them; where
    that of level 2 is, all over the cell at every heading.
    `first`: the heading that is tried first.
    """
    nx = costs.shape[1]
    x, y = cell % nx + 0.5, cell // nx + 0.5
    if center_cost(costs, p, x, y) < 0:
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
def cells_may_connect(costs, bits, shape, field, front, p, seen, lists, ends, headings, most):
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


TURN: Final = 0.25
"""Cells: how far a point of the footprint moves in half the angle between two headings."""
WITHIN_CELL: Final = math.sqrt(0.5)
"""Cells: how far the middle of a cell is from its other points."""
BUCKETS: Final = 4096
"""Of the queue of cells."""
MOST: Final = 1_000_000
"""Checks of the footprint, after which nothing is proved."""


def may_connect(
    costs: NDArray[np.uint8],
    bits: NDArray[np.uint64],
    shape: Shape,
    heuristic: tuple[NDArray[np.void], NDArray[np.void]],
    settings: NDArray[np.void],
    start: Pose,
) -> bool:
    """Return False if it is certain that no path leads from `start` to the goal of the heuristic or near it (tolerance)."""
    p, (ny, nx) = settings[0], costs.shape
    rows = smaller(shape)
    headings = max(8, math.ceil(math.pi * shape.reach / TURN))
    seen, after = (untouched_zeros(nx * ny, np.dtype(kind)) for kind in (np.int16, np.int32))
    lists = np.full(BUCKETS, -1, np.int32), after
    near = float(p["tolerance"]) + 2.0 * WITHIN_CELL
    ends = int(start[1]) * nx + int(start[0]), float(p["goal_x"]), float(p["goal_y"]), near
    return bool(cells_may_connect(costs, bits, rows, *heuristic, p, seen, lists, ends, headings, MOST))


def smaller(shape: Shape) -> NDArray[np.float64]:
    """Return rows as of `Shape`: of what remains of the footprint where its points move within a cell and half a heading.

    Level 1: within parts of these. Level 2: of what it covers at all headings, within a cell. Where nothing remains, that is a
    triangle without area, which is blocked nowhere.
    """
    rows = np.zeros((12, 2 * shape.rows.shape[1] + 8))
    corners = int(shape.rows[0, 0])
    whole = shapely.Polygon(shape.rows[6:8, :corners].T if corners > 0 else None)
    padding, center = float(shape.rows[1, 0]), shapely.Point(0.0, 0.0)
    inside = whole.exterior.distance(center) if whole.contains(center) else 0.0
    turns = 0.25 * math.pi * np.arange(8)
    octagon = max(0.0, inside - WITHIN_CELL - padding) * np.column_stack((np.cos(turns), np.sin(turns)))
    for level, parts in enumerate((1, PARTS, 0)):
        points = octagon
        if parts > 0:
            by = (WITHIN_CELL + TURN) / parts + padding
            left = shapely.get_parts(whole.buffer(-by, join_style="mitre", mitre_limit=100.0))
            points = np.asarray(max(left, key=shapely.area).exterior.coords)[:-1] if len(left) else np.zeros((0, 2))
        rows[0, level] = 3
        if 3 <= len(points) <= rows.shape[1]:
            rows[0, level], rows[6 + 2 * level : 8 + 2 * level, : len(points)] = len(points), points.T
    return rows
