# pyright: basic
"""Costs under the robot's footprint at a pose (base_local_planner's CostmapModel)."""

from __future__ import annotations

import math

import numpy as np

from navstack.core.jit import kernel
from navstack.core.line_kernels import FIXED

OUTSIDE = 256
"""Cost of a footprint with a corner outside the grid."""

BORDER = 1e-9
"""Cells: a polygon that reaches less far into a cell only touches it."""


@kernel
def place_footprint(costs, origin_x, origin_y, resolution, corners, x, y, yaw, placed):
    """Write the corners of a footprint at a pose to `placed` (2, n), in cells of the grid; return False if one is outside it.

    `corners` (2, n): x and y of the corners in the robot's frame (m).
    """
    ny, nx = costs.shape
    c, s = math.cos(yaw), math.sin(yaw)
    outside = 0
    for j in range(np.uint64(corners.shape[1])):
        vx, vy = corners[0, j], corners[1, j]
        fx = ((x + (vx * c - vy * s)) - origin_x) / resolution
        fy = ((y + (vx * s + vy * c)) - origin_y) / resolution
        inside = (fx >= 0.0) & (fy >= 0.0) & (fx < nx) & (fy < ny)
        outside += not inside
        placed[0, j] = fx if inside else 0.0
        placed[1, j] = fy if inside else 0.0
    return outside == 0


@kernel
def fastest_corner(corners, vx, vy, turning):
    """Return the speed (m/s) of the fastest corner of a footprint, or of the robot's center, at a velocity.

    `corners` (2, n): x and y of the corners in the robot's frame (m); `turning` (rad/s).
    """
    fastest = vx * vx + vy * vy
    for j in range(corners.shape[1]):
        x, y = vx - turning * corners[1, j], vy + turning * corners[0, j]
        fastest = max(fastest, x * x + y * y)
    return math.sqrt(fastest)


@kernel
def edge_cost(costs, origin_x, origin_y, resolution, corners, x, y, yaw, cells):
    """Return the highest cost on the edges of a footprint at a pose; OUTSIDE if a corner is outside the grid.

    `corners` (2, n): x and y of the corners in the robot's frame (m). `cells` (2, n) int32 is scratch. Each edge is a line of
    cells from the cell of one corner to that of the next one (Bresenham): it can miss cells that the footprint overlaps, see
    `overlapped_cost`.
    """
    ny, nx = costs.shape
    c, s = math.cos(yaw), math.sin(yaw)
    number = corners.shape[1]
    outside = 0
    # as in `place_footprint`; integers of 32 bits, because the loop is then vectorized
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
    longest = 0
    x0, y0 = np.int64(cells[0, number - 1]), np.int64(cells[1, number - 1])
    # starts with the closing edge: the order does not change the highest cost; unsigned indices are not checked for wrapping
    for j in range(np.uint64(number)):
        x1, y1 = np.int64(cells[0, j]), np.int64(cells[1, j])
        dx, dy = x1 - x0, y1 - y0
        steps = max(abs(dx), abs(dy))
        longest = max(longest, steps)
        # an edge of two steps has one cell between its ends
        two = steps == 2
        middle_x = x0 + (np.int64(dx > 0) - np.int64(dx < 0) if two else 0)
        middle_y = y0 + (np.int64(dy > 0) - np.int64(dy < 0) if two else 0)
        highest = max(highest, costs[np.uint64(y0), np.uint64(x0)])
        highest = max(highest, costs[np.uint64(middle_y), np.uint64(middle_x)])
        x0, y0 = x1, y1
    if longest > 2:
        highest = max(highest, long_edge_cost(costs.ravel(), nx, cells))
    return np.int64(highest)


@kernel
def long_edge_cost(flat, nx, cells):
    """Return the highest cost between the ends of the edges of more than two steps; `flat`: costs of a grid `nx` cells wide.

    `cells` (2, n): ix and iy of the corners.
    """
    number = cells.shape[1]
    highest = np.uint8(0)
    x0, y0 = np.int64(cells[0, number - 1]), np.int64(cells[1, number - 1])
    for j in range(number):
        x1, y1 = np.int64(cells[0, j]), np.int64(cells[1, j])
        dx, dy = x1 - x0, y1 - y0
        long_x, long_y = abs(dx), abs(dy)
        along_x = long_x >= long_y
        steps = long_x if along_x else long_y
        if steps > 2:
            # the cell after i steps is (steps // 2 + i * add) // steps cells along the minor axis; as in `clear_line`, the
            # slope in fixed point makes the cells independent of each other
            step_x = 1 if dx > 0 else -1
            step_y = nx if dy > 0 else -nx
            major, minor = (step_x, step_y) if along_x else (step_y, step_x)
            scale = (1 << FIXED) / steps
            slope = np.int64((long_y if along_x else long_x) * scale) + 1
            at = np.int64((steps // 2) * scale) + 1
            cell = y0 * nx + x0
            for _ in range(np.uint64(steps - 1)):
                cell += major
                at += slope
                highest = max(highest, flat[np.uint64(cell + (at >> FIXED) * minor)])
        x0, y0 = x1, y1
    return highest


@kernel
def overlaps_cell(placed, ix, iy):
    """Return True if the polygon `placed` (2, n), in cells, and the cell have more in common than their borders."""
    return overlaps_box(placed, ix, iy, ix + 1.0, iy + 1.0)


@kernel
def overlaps_box(placed, x0, y0, x1, y1):
    """Return True if the polygon `placed` (2, n) and the box x0 <= x <= x1, y0 <= y <= y1 have more in common than borders."""
    left, right = x0 + BORDER, x1 - BORDER
    low, high = y0 + BORDER, y1 - BORDER
    n = placed.shape[1]
    level, center = 0.5 * (y0 + y1), 0.5 * (x0 + x1)
    inside = False
    px, py = placed[0, n - 1], placed[1, n - 1]
    for i in range(n):
        qx, qy = placed[0, i], placed[1, i]
        # clip the edge to the rows, then to the columns of the box
        if min(py, qy) < high and max(py, qy) > low and min(px, qx) < right and max(px, qx) > left:
            begin, end = 0.0, 1.0
            dx, dy = qx - px, qy - py
            if dy != 0.0:
                a, b = (low - py) / dy, (high - py) / dy
                begin, end = max(begin, min(a, b)), min(end, max(a, b))
            if dx != 0.0:
                a, b = (left - px) / dx, (right - px) / dx
                begin, end = max(begin, min(a, b)), min(end, max(a, b))
            if begin < end:
                return True
        # no edge in the box: it is inside if an odd number of edges cross its row to the left of its center
        if (py > level) != (qy > level) and center > px + (level - py) / (qy - py) * (qx - px):
            inside = not inside
        px, py = qx, qy
    return inside


@kernel
def overlapped_cost(costs, placed, highest):
    """Return the highest cost of the cells that a polygon overlaps, enclosed ones included; at least `highest`.

    `placed` (2, n): the corners in cells, inside the grid (see `place_footprint`). Exact for every simple polygon: a cell counts
    if it and the polygon have more than borders in common.
    """
    for iy in range(np.int64(placed[1].min()), np.int64(placed[1].max()) + 1):
        for ix in range(np.int64(placed[0].min()), np.int64(placed[0].max()) + 1):
            if np.int64(costs[iy, ix]) > highest and overlaps_cell(placed, ix, iy):
                highest = np.int64(costs[iy, ix])
    return highest


@kernel
def overlaps_lethal(costs, placed):
    """Return True if a polygon overlaps a lethal cell. Arguments as of `overlapped_cost`."""
    nx = costs.shape[1]
    flat = costs.ravel()
    left, right, low, high = placed[0, 0], placed[0, 0], placed[1, 0], placed[1, 0]
    for j in range(1, placed.shape[1]):
        left, right = min(left, placed[0, j]), max(right, placed[0, j])
        low, high = min(low, placed[1, j]), max(high, placed[1, j])
    x0 = np.int64(left)
    number = np.uint64(np.int64(right) - x0 + 1)
    for iy in range(np.int64(low), np.int64(high) + 1):
        base = np.uint64(iy * nx + x0)
        for i in range(number):
            if flat[base + i] == 254 and overlaps_cell(placed, x0 + np.int64(i), iy):
                return True
    return False


@kernel
def footprint_overlaps_lethal(costs, origin_x, origin_y, resolution, corners, x, y, yaw, placed):
    """Return True if a footprint inside the grid overlaps a lethal cell; `placed` (2, n) is scratch."""
    place_footprint(costs, origin_x, origin_y, resolution, corners, x, y, yaw, placed)
    return overlaps_lethal(costs, placed)


@kernel
def pose_cost(costs, origin_x, origin_y, resolution, vertices, x, y, yaw, interior):
    """Return the highest cost under the footprint `vertices` (n, 2) at a pose; OUTSIDE if a part of it is outside the grid.

    The edges count (as in C++) and, with `interior`, every cell that the footprint overlaps.
    """
    ny, nx = costs.shape
    cx, cy = (x - origin_x) / resolution, (y - origin_y) / resolution
    if not (cx >= 0.0 and cy >= 0.0 and cx < nx and cy < ny):
        return OUTSIDE
    corners = vertices.T.copy()
    cells = np.empty(corners.shape, np.int32)
    highest = edge_cost(costs, origin_x, origin_y, resolution, corners, x, y, yaw, cells)
    if highest == OUTSIDE or not interior:
        return highest
    placed = np.empty(corners.shape)
    place_footprint(costs, origin_x, origin_y, resolution, corners, x, y, yaw, placed)
    highest = max(highest, np.int64(costs[int(cy), int(cx)]))
    return overlapped_cost(costs, placed, highest)


@kernel
def lethal_under(costs, origin_x, origin_y, resolution, vertices, x, y, yaw):
    """Return True if the footprint `vertices` (n, 2) at a pose is inside the grid and overlaps a lethal cell."""
    corners = vertices.T.copy()
    placed = np.empty(corners.shape)
    inside = place_footprint(costs, origin_x, origin_y, resolution, corners, x, y, yaw, placed)
    return inside and overlaps_lethal(costs, placed)


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
