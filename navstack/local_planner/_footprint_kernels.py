# pyright: basic
"""Costs under the robot's outline at a pose (base_local_planner's CostmapModel)."""

from __future__ import annotations

import math

import numpy as np

from navstack.core.jit import kernel

ON_LETHAL = -1
ON_UNKNOWN = -2
OFF_MAP = -3


@kernel
def between(nx, out):
    """Into `out` (25,): from an edge's first cell to the cell between, by `5 * (dy + 2) + dx + 2` of its last cell.

    For edges of at most two steps; those of less have none between and get 0, their first cell again.
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
    """The highest cost under the outline at a pose, 254 and more when it collides; 256 off the map.

    Each edge is walked cell by cell from one corner's cell to the next one's (Bresenham, the longer axis leading).
    `corners` (2, n): x and y of the outline's corners about its centre. `middles` (25,) as `between` left it, `cells`
    (2, n) int32 is scratch.
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
        return np.int64(256)
    highest = np.uint8(0)
    x0, y0 = np.int64(cells[0, number - 1]), np.int64(cells[1, number - 1])
    # the edge that closes the outline comes first here: only the highest cost counts
    for j in range(number):
        x1, y1 = np.int64(cells[0, j]), np.int64(cells[1, j])
        dx, dy = x1 - x0, y1 - y0
        cell = y0 * nx + x0
        highest = max(highest, flat[cell])
        if max(abs(dx), abs(dy)) <= 2:
            highest = max(highest, flat[cell + middles[5 * (dy + 2) + dx + 2]])
        else:
            step_x = 1 if dx >= 0 else -1
            step_y = nx if dy >= 0 else -nx
            dx, dy = abs(dx), abs(dy)
            along_x = dx >= dy
            steps = dx if along_x else dy
            add = dy if along_x else dx
            major = step_x if along_x else step_y
            minor = step_y if along_x else step_x
            error = steps // 2
            for _ in range(steps - 1):
                cell += major
                error += add
                over = error >= steps
                error -= steps if over else 0
                cell += minor if over else 0
                highest = max(highest, flat[cell])
        x0, y0 = x1, y1
    return np.int64(highest)


@kernel
def perimeter_cost(costs, origin_x, origin_y, resolution, vertices, x, y, yaw, scale):
    """The highest cost under the outline `vertices` (n, 2), scaled by `scale`, at a pose; or ON_LETHAL, ON_UNKNOWN, OFF_MAP."""
    number = len(vertices)
    corners = np.empty((2, number))
    for j in range(number):
        corners[0, j] = scale * vertices[j, 0]
        corners[1, j] = scale * vertices[j, 1]
    middles = np.empty(25, np.int64)
    between(costs.shape[1], middles)
    cells = np.empty((2, number), np.int32)
    highest = footprint_cost(costs, origin_x, origin_y, resolution, corners, x, y, yaw, middles, cells)
    if highest < 254:
        return highest
    return collision_reason(costs, origin_x, origin_y, resolution, corners, x, y, yaw)


@kernel
def collision_reason(costs, origin_x, origin_y, resolution, corners, x, y, yaw):
    """ON_LETHAL, ON_UNKNOWN or OFF_MAP: what the walk along the outline meets first, known to meet one of them."""
    ny, nx = costs.shape
    c, s = math.cos(yaw), math.sin(yaw)
    number = corners.shape[1]
    x0, y0 = 0, 0
    for i in range(number + 1):
        j = 0 if i == number else i
        vx, vy = corners[0, j], corners[1, j]
        fx = ((x + (vx * c - vy * s)) - origin_x) / resolution
        fy = ((y + (vx * s + vy * c)) - origin_y) / resolution
        if not (fx >= 0.0 and fy >= 0.0 and fx < nx and fy < ny):
            return OFF_MAP
        x1, y1 = int(fx), int(fy)
        if i > 0:
            steps = max(abs(x1 - x0), abs(y1 - y0))
            along_x = abs(x1 - x0) >= abs(y1 - y0)
            add = abs(y1 - y0) if along_x else abs(x1 - x0)
            for m in range(steps + 1):
                side = (steps // 2 + m * add) // max(steps, 1)
                ix = x0 + (m if along_x else side) * (1 if x1 >= x0 else -1)
                iy = y0 + (side if along_x else m) * (1 if y1 >= y0 else -1)
                cost = costs[iy, ix]
                if cost == 254:
                    return ON_LETHAL
                if cost == 255:
                    return ON_UNKNOWN
        x0, y0 = x1, y1
    return OFF_MAP
