# pyright: basic
"""Costs under the robot's footprint at a pose (base_local_planner's CostmapModel)."""

from __future__ import annotations

import math

import numpy as np

from navstack.core.jit import kernel
from navstack.core.line_kernels import line_next, line_start

OUTSIDE = 256
"""Cost of a footprint with a corner outside the grid."""


@kernel
def middle_offsets(nx, out):
    """Tabulate into `out` (25,) the flat offset from the first to the middle cell of each edge of at most two steps.

    The index is `5 * (dy + 2) + dx + 2` of the last cell relative to the first. Shorter edges have no middle cell: offset 0.
    """
    for dy in range(-2, 3):
        for dx in range(-2, 3):
            step_x = 1 if dx >= 0 else -1
            step_y = nx if dy >= 0 else -nx
            offset = 0
            if abs(dx) == 2:
                offset = step_x + (step_y if dy != 0 else 0)
            elif abs(dy) == 2:
                offset = step_y + (step_x if dx != 0 else 0)
            out[5 * (dy + 2) + dx + 2] = offset


@kernel
def footprint_cost(costs, origin_x, origin_y, resolution, corners, x, y, yaw, middles, cells):
    """Return the highest cost on the edges of a footprint at a pose; OUTSIDE if a corner is outside the grid.

    `corners` (2, n): x and y of the corners in the robot's frame (m). `middles` (25,) as `middle_offsets` returns it; `cells`
    (2, n) int32 is scratch. Each edge is a line of cells from the cell of one corner to that of the next one.
    """
    ny, nx = costs.shape
    flat = costs.ravel()
    c, s = math.cos(yaw), math.sin(yaw)
    number = corners.shape[1]
    outside = 0
    for j in range(np.uint64(number)):
        vx, vy = corners[0, j], corners[1, j]
        fx = ((x + (vx * c - vy * s)) - origin_x) / resolution
        fy = ((y + (vx * s + vy * c)) - origin_y) / resolution
        inside = (fx >= 0.0) & (fy >= 0.0) & (fx < nx) & (fy < ny)
        outside += not inside
        cells[0, j] = np.int32(fx if inside else 0.0)
        cells[1, j] = np.int32(fy if inside else 0.0)
    if outside > 0:
        return np.int64(OUTSIDE)
    highest = np.uint8(0)
    x0, y0 = np.int64(cells[0, number - 1]), np.int64(cells[1, number - 1])
    # starts with the closing edge: the order does not change the highest cost
    for j in range(number):
        x1, y1 = np.int64(cells[0, j]), np.int64(cells[1, j])
        dx, dy = x1 - x0, y1 - y0
        cell = y0 * nx + x0
        highest = max(highest, flat[cell])
        if max(abs(dx), abs(dy)) <= 2:
            highest = max(highest, flat[cell + middles[5 * (dy + 2) + dx + 2]])
        else:
            line = line_start(x0, y0, x1, y1, nx)
            error = line[0] // 2
            for _ in range(line[0] - 1):
                cell, error = line_next(cell, error, line)
                highest = max(highest, flat[cell])
        x0, y0 = x1, y1
    return np.int64(highest)


@kernel
def interior_cost(costs, corners, highest):
    """Return the highest cost of the cells whose centre is inside a polygon (even-odd rule), at least `highest`.

    `corners` (2, n): the polygon in cells, inside the grid.
    """
    n = corners.shape[1]
    low_x, high_x = int(corners[0].min()), int(corners[0].max())
    for iy in range(int(corners[1].min()), int(corners[1].max()) + 1):
        level = iy + 0.5
        for ix in range(low_x, high_x + 1):
            if int(costs[iy, ix]) <= highest:
                continue
            # inside if an odd number of edges cross the row of the cell to the left of its centre
            centre = ix + 0.5
            inside = False
            px, py = corners[0, n - 1], corners[1, n - 1]
            for i in range(n):
                qx, qy = corners[0, i], corners[1, i]
                if (py > level) != (qy > level) and centre > px + (level - py) / (qy - py) * (qx - px):
                    inside = not inside
                px, py = qx, qy
            if inside:
                highest = int(costs[iy, ix])
    return highest


@kernel
def pose_cost(costs, origin_x, origin_y, resolution, vertices, x, y, yaw, interior):
    """Return the highest cost under the footprint `vertices` (n, 2) at a pose; OUTSIDE if a part of it is outside the grid.

    The edges count and, with `interior`, the cells whose centre is inside.
    """
    ny, nx = costs.shape
    cx, cy = (x - origin_x) / resolution, (y - origin_y) / resolution
    if not (cx >= 0.0 and cy >= 0.0 and cx < nx and cy < ny):
        return OUTSIDE
    corners = vertices.T.copy()
    middles = np.empty(25, np.int64)
    middle_offsets(nx, middles)
    highest = footprint_cost(
        costs, origin_x, origin_y, resolution, corners, x, y, yaw, middles, np.empty(corners.shape, np.int32)
    )
    if highest == OUTSIDE or not interior:
        return highest
    c, s = math.cos(yaw), math.sin(yaw)
    for j in range(corners.shape[1]):
        vx, vy = corners[0, j], corners[1, j]
        corners[0, j] = ((x + (vx * c - vy * s)) - origin_x) / resolution
        corners[1, j] = ((y + (vx * s + vy * c)) - origin_y) / resolution
    return interior_cost(costs, corners, max(highest, int(costs[int(cy), int(cx)])))


@kernel
def turn_cost(costs, origin_x, origin_y, resolution, vertices, x, y, yaw, arc, step, limit, interior):
    """Return the highest `pose_cost` of a turn in place by `arc` (rad), checked every `step` (rad), and the angle turned.

    The turn ends at the first heading with a cost of at least `limit`, or outside the grid.
    """
    highest = 0
    size = abs(arc)
    sign = 1.0 if arc >= 0.0 else -1.0
    for k in range(math.ceil(size / step - 1e-9) + 1):
        turned = min(k * step, size)
        cost = pose_cost(costs, origin_x, origin_y, resolution, vertices, x, y, yaw + sign * turned, interior)
        if cost == OUTSIDE or cost >= limit:
            return cost, sign * turned
        highest = max(highest, cost)
    return highest, arc
