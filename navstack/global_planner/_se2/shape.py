"""The footprint as the kernels of the search over poses see it."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from navstack.core import Footprint, overlaps_box, plain_kernel

STEP: Final = 0.3
"""Cells: largest motion of a point of the footprint between two samples of a primitive."""
PADDINGS: Final = (0.15, 0.6, 2.2)
"""Cells: a footprint that is padded by this much and free at a pose is free wherever no point of it moves farther.

A check with the largest padding covers most of a motion at once; where it fails, smaller ones follow, and last a fine one.
"""
FINE: Final = (0.01, 0.002, 0.0)
"""Cells: fine paddings. The first one with which the robot fits at its start and its goal is used."""
FINEST_STEP: Final = 0.003
ROUND_STEP: Final = 0.5


class Shape(NamedTuple):
    """A footprint in cells."""

    corners: int
    """0 for a round robot: the costs of cells decide where its center may be."""
    rows: NDArray[np.float64]
    """(6 + 2 levels, k): number of corners and padding per level, four rows of scratch, then x and y of the corners per level.

    Level 0 has the fine padding, the others have PADDINGS.
    """
    reach: float
    """Circumscribed radius, the first of PADDINGS included; 0 for a round robot."""
    step: float
    fine_step: float
    convex: bool


def shape_of(footprint: Footprint | None, resolution: float, fine: float = FINE[0]) -> Shape:
    """The footprint in cells of `resolution` (m), padded by `fine` (cells), and by PADDINGS."""
    if footprint is None or footprint.is_round:
        return _ROUND
    shape = _polygon(footprint, resolution, fine)
    return shape._replace(rows=shape.rows.copy())  # the kernels write to it


@lru_cache(maxsize=32)
def _polygon(footprint: Footprint, resolution: float, fine: float) -> Shape:
    polygon = shapely.Polygon(footprint.vertices / resolution)
    levels = [_corners(polygon, padding) for padding in (fine, *PADDINGS)]
    far = max(float(np.hypot(*corners.T).max()) for corners in levels)
    convex = bool(abs(polygon.convex_hull.area - polygon.area) < 1e-9 * polygon.area)
    width = max(*(len(corners) for corners in levels), math.ceil(2.0 * far) + 4)
    rows = np.zeros((6 + 2 * len(levels), width))
    for level, (corners, padding) in enumerate(zip(levels, (fine, *PADDINGS), strict=True)):
        rows[0, level], rows[1, level] = len(corners), padding
        rows[6 + 2 * level : 8 + 2 * level, : len(corners)] = corners.T
    reach = float(np.hypot(*levels[1].T).max())
    return Shape(len(levels[0]), rows, reach, STEP, max(FINEST_STEP, 1.4 * fine), convex)


def _corners(polygon: shapely.Polygon, padding: float) -> NDArray[np.float64]:
    """Corners (n, 2) of a padded polygon."""
    padded = polygon.buffer(padding, join_style="mitre", mitre_limit=3.0) if padding > 0.0 else polygon
    return np.asarray(padded.exterior.coords)[:-1]


_ROUND: Final = Shape(0, np.zeros((6, 1)), 0.0, ROUND_STEP, ROUND_STEP, True)


# ----------------------------------------------------------------------------------------------------------------------
# Exact collision checks of a footprint, over the lethal cells of a costmap packed into bits, 64 cells to a word.
#
# `bits` (ny + tile rows, words) uint64: a tile of 64 x 64 cells is packed when it is first needed; then its word in the rows
# after `ny` is 1. Coordinates are in cells.


# pyright: basic


TILE = 64
EDGE = 1e-9
"""Cells: a polygon that reaches less far into a cell only touches it."""
LETHAL = np.uint8(254)
UNKNOWN = np.uint8(255)


@plain_kernel
def pack_tile(costs, bits, tx, ty, unknown_blocked):
    """Pack the blocked cells of a tile."""
    ny, nx = costs.shape
    first = tx * TILE
    count = min(TILE, nx - first)
    for iy in range(ty * TILE, min(ny, (ty + 1) * TILE)):
        word = np.uint64(0)
        for i in range(count):
            cost = costs[iy, first + i]
            blocked = (cost == LETHAL) | ((cost == UNKNOWN) & (unknown_blocked != 0))
            word |= np.uint64(blocked) << np.uint64(i)
        bits[iy, tx] = word
    bits[ny + ty, tx] = np.uint64(1)


@plain_kernel
def span_blocked(bits, iy, x0, x1):
    """Return True if a packed cell from x0 to x1 of a row is blocked."""
    w0, w1 = x0 >> 6, x1 >> 6
    low = np.uint64(0xFFFFFFFFFFFFFFFF) << np.uint64(x0 & 63)
    high = np.uint64(0xFFFFFFFFFFFFFFFF) >> np.uint64(63 - (x1 & 63))
    if w0 == w1:
        return (bits[iy, w0] & low & high) != np.uint64(0)
    if (bits[iy, w0] & low) != np.uint64(0) or (bits[iy, w1] & high) != np.uint64(0):
        return True
    between = np.uint64(0)
    for w in range(w0 + 1, w1):
        between |= bits[iy, w]
    return between != np.uint64(0)


@plain_kernel
def box_blocked(costs, bits, x0, y0, x1, y1, unknown_blocked):
    """Return True if a cell in the box is blocked, or a part of it is outside the grid; packs the tiles that it needs."""
    ny, nx = costs.shape
    if x0 < 0 or y0 < 0 or x1 >= nx or y1 >= ny:
        return True
    for ty in range(y0 >> 6, (y1 >> 6) + 1):
        for tx in range(x0 >> 6, (x1 >> 6) + 1):
            if bits[ny + ty, tx] == np.uint64(0):
                pack_tile(costs, bits, tx, ty, unknown_blocked)
    iy = y0
    while iy <= y1 and not span_blocked(bits, iy, x0, x1):
        iy += 1
    return iy <= y1


@plain_kernel
def outline_blocked(costs, bits, shape, level, p, x, y, c, s):
    """Return True if the footprint, padded as in `level`, overlaps a blocked cell or the outside of the grid.

    (x, y) and (c, s): its position and heading. `shape`: `Shape.rows`. The tiles under it are packed, or do not matter.
    """
    ny, nx = costs.shape
    first, n = 6 + 2 * level, np.int64(shape[0, level])
    left, right, low, high = np.inf, -np.inf, np.inf, -np.inf
    for j in range(n):
        px = x + c * shape[first, j] - s * shape[first + 1, j]
        py = y + s * shape[first, j] + c * shape[first + 1, j]
        shape[4, j], shape[5, j] = px, py
        left, right, low, high = min(left, px), max(right, px), min(low, py), max(high, py)
    if not (left >= 0.0 and low >= 0.0 and right <= nx and high <= ny):
        return True
    r0, r1 = np.int64(low + EDGE), min(np.int64(high - EDGE), ny - 1)
    # only rows from the first to the last one with a blocked cell in the box around the footprint matter
    first_x, last_x = np.int64(left), min(np.int64(right), nx - 1)
    while r0 <= r1 and not span_blocked(bits, r0, first_x, last_x):
        r0 += 1
    while r0 < r1 and not span_blocked(bits, r1, first_x, last_x):
        r1 -= 1
    for r in range(r1 - r0 + 1):
        shape[2, r], shape[3, r] = np.inf, -np.inf
    px, py = shape[4, n - 1], shape[5, n - 1]
    for j in range(n):
        qx, qy = shape[4, j], shape[5, j]
        ax, ay, bx, by = px, py, qx, qy
        if ay > by:
            ax, ay, bx, by = qx, qy, px, py
        slope = (bx - ax) / (by - ay) if by > ay else 0.0
        for r in range(max(np.int64(ay), r0), min(np.int64(by), r1) + 1):
            x0 = ax + (max(ay, np.float64(r)) - ay) * slope
            x1 = ax + (min(by, r + 1.0) - ay) * slope
            if by <= ay:
                x1 = bx
            shape[2, r - r0] = min(shape[2, r - r0], x0, x1)
            shape[3, r - r0] = max(shape[3, r - r0], x0, x1)
        px, py = qx, qy
    for r in range(r1 - r0 + 1):
        if shape[2, r] < shape[3, r] - 2.0 * EDGE:
            x0, x1 = np.int64(shape[2, r] + EDGE), min(np.int64(shape[3, r] - EDGE), nx - 1)
            if span_blocked(bits, r0 + r, x0, x1):
                if p.convex != 0:
                    return True
                for ix in range(x0, x1 + 1):
                    if span_blocked(bits, r0 + r, ix, ix) and overlaps_box(
                        shape[4:6, :n], np.float64(ix), np.float64(r0 + r), ix + 1.0, r0 + r + 1.0
                    ):
                        return True
    return False


@plain_kernel
def shape_blocked(costs, bits, shape, p, x, y, c, s):
    """Return True if the padded footprint at (x, y) with heading (c, s) overlaps a blocked cell or the outside of the grid."""
    return outline_blocked(costs, bits, shape, 1, p, x, y, c, s)


@plain_kernel
def motion_blocked(costs, bits, shape, p, start, goal):
    """Return True if the finely padded footprint is blocked between two poses (3,) on an arc, the ends included.

    `p.fine_step`: largest motion of its points between checks. For stretches on which the padded footprint is blocked.
    """
    dx, dy, turn = goal[0] - start[0], goal[1] - start[1], goal[2] - start[2]
    chord = math.hypot(dx, dy)
    count = max(1, math.ceil((chord + p.reach * abs(turn)) / p.fine_step))
    bend = math.sin(0.5 * turn)
    c, s = (dx / chord, dy / chord) if chord > 0.0 else (1.0, 0.0)
    for k in range(count, 0, -1):
        share = (k - 0.5) / count
        along, aside = chord * share, 0.0
        if abs(bend) > 1e-6:
            # the chord of a part of the arc is turned from the whole chord by half of the rest of the turn
            part = chord * math.sin(0.5 * turn * share) / bend
            angle = 0.5 * turn * (1.0 - share)
            along, aside = part * math.cos(angle), -part * math.sin(angle)
        yaw = start[2] + turn * share
        x, y = start[0] + c * along - s * aside, start[1] + s * along + c * aside
        if outline_blocked(costs, bits, shape, 0, p, x, y, math.cos(yaw), math.sin(yaw)):
            return True
    return False


@plain_kernel
def near_obstacles(costs, bits, p, left, low, right, high):
    """Return True if a blocked cell, or the outside, may touch the footprint anywhere in a box; packs its tiles."""
    x0, y0 = math.floor(left - p.reach), math.floor(low - p.reach)
    x1, y1 = math.floor(right + p.reach), math.floor(high + p.reach)
    ny, nx = costs.shape
    outside = x0 < 0 or y0 < 0 or x1 >= nx or y1 >= ny
    blocked = box_blocked(costs, bits, max(x0, 0), max(y0, 0), min(x1, nx - 1), min(y1, ny - 1), p.unknown_blocked)
    # not `outside or blocked`: the tiles must be packed in either case
    return outside | blocked


@plain_kernel
def center_cost(costs, p, x, y):
    """Return the cost of the cell of a point, or -1 if the robot's center must not be in it."""
    ny, nx = costs.shape
    if not (x >= 0.0 and y >= 0.0 and x < nx and y < ny):
        return -1
    cost = np.int64(costs[np.int64(y), np.int64(x)])
    if cost == 255:
        return -1 if p.unknown_blocked != 0 else 255
    return -1 if cost >= 253 else cost


@plain_kernel
def cell_weight(p, cost):
    """Return the cost of driving one cell's length over a cell of this cost."""
    share = cost / 252.0
    if p.quadratic != 0:
        share *= share
    return p.base_cost + p.cost_penalty * share


@plain_kernel
def pose_free(costs, bits, shape, p, x, y, yaw):
    """Return True if the robot may be at a pose."""
    if center_cost(costs, p, x, y) < 0:
        return False
    if p.corners == 0:
        return True
    if not near_obstacles(costs, bits, p, x, y, x, y):
        return True
    return not outline_blocked(costs, bits, shape, 0, p, x, y, math.cos(yaw), math.sin(yaw))
