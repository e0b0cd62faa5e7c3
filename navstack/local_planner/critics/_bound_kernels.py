# pyright: basic
"""Upper bounds of the footprint's cost: where they cannot change a rollout's score, the footprint is not rasterized."""

from __future__ import annotations

import math

import numpy as np

from navstack.core.footprint_kernels import OUTSIDE, overlaps_box, overlaps_cell
from navstack.core.jit import kernel
from navstack.core.line_kernels import FIXED

SQUARE = 4
"""Cells around a cell in each direction of which `highest_in_squares` takes the highest cost."""
PART = 2 * SQUARE + 1
"""Cells of an edge that one such square contains."""
BOUND_GRIDS = 4
"""Grids of `bound_footprint_costs`."""


@kernel
def highest_around(costs, x0, y0, x1, y1, reach, rows, out):
    """Write an upper bound of the footprint's cost to `out` (ny, nx), for the cells x0 <= ix < x1, y0 <= iy < y1.

    The bound of a cell is the highest cost among all cells that a footprint can touch whose points are at most `reach` cells
    from a centre anywhere in that cell: along each axis a point's cell is less than one cell away, and a cell of a rasterized
    edge at most half a cell more. Cells from which the footprint can leave the map get 255. `rows` (ny, nx) is scratch.
    """
    ny, nx = costs.shape
    source, across, target = costs.ravel(), rows.ravel(), out.ravel()
    radius = math.ceil(reach)
    low_x, high_x = max(x0, radius), min(x1, nx - radius)
    low_y, high_y = max(y0, radius), min(y1, ny - radius)
    for iy in range(y0, y1):
        for ix in range(x0, x1):
            out[iy, ix] = 0 if low_x <= ix < high_x and low_y <= iy < high_y else 255
    if low_x >= high_x or low_y >= high_y:
        return
    # unsigned indices cannot wrap around, so the loops over a row are vectorized
    number = np.uint64(high_x - low_x)
    for iy in range(low_y - radius, high_y + radius):
        base = np.uint64(iy * nx + low_x)
        for i in range(number):
            across[base + i] = source[base + i]
    width = 0
    for dy in range(radius, -1, -1):
        squared = reach * reach
        wanted = 0
        if squared >= max(0.0, dy - 1.0) ** 2:
            wanted = int(1.5 + math.sqrt(squared - max(0.0, dy - 1.0) ** 2))
        if squared >= max(0.0, dy - 1.5) ** 2:
            wanted = max(wanted, int(1.0 + math.sqrt(squared - max(0.0, dy - 1.5) ** 2)))
        while width < min(wanted, radius):
            width += 1
            for iy in range(low_y - radius, high_y + radius):
                base = np.uint64(iy * nx + low_x)
                left = np.uint64(iy * nx + low_x - width)
                right = np.uint64(iy * nx + low_x + width)
                for i in range(number):
                    across[base + i] = max(across[base + i], max(source[left + i], source[right + i]))
        for iy in range(low_y, high_y):
            base = np.uint64(iy * nx + low_x)
            above = np.uint64((iy + dy) * nx + low_x)
            below = np.uint64((iy - dy) * nx + low_x)
            for i in range(number):
                target[base + i] = max(target[base + i], max(across[above + i], across[below + i]))


@kernel
def footprint_scale(command, settings):
    """Factor by which the footprint has grown at the speed of `command`."""
    speed = math.hypot(command[0], command[1])
    if speed > settings.scaling_speed:
        return (
            settings.max_scaling * ((speed - settings.scaling_speed) / (settings.max_speed - settings.scaling_speed))
            + 1.0
        )
    return 1.0


@kernel
def highest_in_squares(costs, x0, y0, x1, y1, rows, out):
    """Write the highest cost at most SQUARE cells away along each axis to `out` (ny, nx), for x0 <= ix < x1, y0 <= iy < y1.

    Cells beyond the map do not count. `rows` (ny, nx) is scratch.
    """
    ny, nx = costs.shape
    source, across, target = costs.ravel(), rows.ravel(), out.ravel()
    low, high = max(y0 - SQUARE, 0), min(y1 + SQUARE, ny)
    # unsigned indices cannot wrap around, so the loops over a row are vectorized
    for iy in range(low, high):
        rows[iy, x0:x1] = costs[iy, x0:x1]
        for dx in range(-SQUARE, SQUARE + 1):
            left, right = max(x0, -dx), min(x1, nx - dx)
            to, start = np.uint64(iy * nx + left), np.uint64(iy * nx + left + dx)
            for i in range(np.uint64(max(right - left, 0))):
                across[to + i] = max(across[to + i], source[start + i])
    for iy in range(y0, y1):
        out[iy, x0:x1] = rows[iy, x0:x1]
        to = np.uint64(iy * nx + x0)
        for other in range(max(iy - SQUARE, low), min(iy + SQUARE + 1, high)):
            start = np.uint64(other * nx + x0)
            for i in range(np.uint64(x1 - x0)):
                target[to + i] = max(target[to + i], across[start + i])


@kernel
def has_long_edges(vertices, resolution):
    """Return True if the edges of a footprint are as long as a square on average: shorter ones are walked faster without."""
    number = len(vertices)
    around = 0.0
    for j in range(number):
        before = number - 1 if j == 0 else j - 1
        around += math.hypot(vertices[j, 0] - vertices[before, 0], vertices[j, 1] - vertices[before, 1])
    return around >= number * PART * resolution


@kernel
def bound_footprint_costs(costs, settings, vertices, commands, alive, box, bounds):
    """Write upper bounds of the cost of the footprint (`bounds[0]`) and of the largest scaled footprint (`bounds[1]`).

    If its edges are long, also `highest_in_squares` to `bounds[2]`, wherever a footprint can be, and return True.

    `box`: x0, y0, x1, y1, see `highest_around`. `bounds` (BOUND_GRIDS, ny, nx): the last one is scratch.
    """
    x0, y0, x1, y1 = np.int64(box[0]), np.int64(box[1]), np.int64(box[2]), np.int64(box[3])
    if x0 >= x1:
        return False
    ny, nx = costs.shape
    largest = 1.0
    for k in range(len(alive)):
        if alive[k]:
            largest = max(largest, footprint_scale(commands[k], settings))
    reach = settings.circumscribed_radius / settings.resolution + 1e-6
    farthest = float(nx + ny)
    scratch = bounds[BOUND_GRIDS - 1]
    highest_around(costs, x0, y0, x1, y1, min(reach, farthest), scratch, bounds[0])
    if largest > 1.0:
        highest_around(costs, x0, y0, x1, y1, min(largest * reach, farthest), scratch, bounds[1])
    if not has_long_edges(vertices, settings.resolution):
        return False
    around = math.ceil(min(largest * reach, farthest)) + 2
    left, low, right, high = max(x0 - around, 0), max(y0 - around, 0), min(x1 + around, nx), min(y1 + around, ny)
    highest_in_squares(costs, left, low, right, high, scratch, bounds[2])
    return True


@kernel
def large_edge_cost(flat, squares, nx, ny, settings, corners, x, y, yaw, cells, floor):
    """Return the highest cost on the edges of a footprint at a pose, if it exceeds `floor`; else at most `floor`.

    As `edge_cost`, without the parts of the edges on which no cell can cost more. `flat`: costs; `squares`: flat, see
    `highest_in_squares`.
    """
    origin_x, origin_y, resolution = settings.origin_x, settings.origin_y, settings.resolution
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
    highest = np.uint8(min(floor, 255))
    x0, y0 = np.int64(cells[0, number - 1]), np.int64(cells[1, number - 1])
    for j in range(np.uint64(number)):
        x1, y1 = np.int64(cells[0, j]), np.int64(cells[1, j])
        dx, dy = x1 - x0, y1 - y0
        long_x, long_y = abs(dx), abs(dy)
        along_x = long_x >= long_y
        steps = long_x if along_x else long_y
        step_x = 1 if dx > 0 else -1
        step_y = nx if dy > 0 else -nx
        major, minor = (step_x, step_y) if along_x else (step_y, step_x)
        # the cell after i steps, in fixed point: see `clear_line`
        scale = (1 << FIXED) / max(steps, 1)
        slope = np.int64((long_y if along_x else long_x) * scale) + 1
        begin = np.int64((steps // 2) * scale) + 1
        first = y0 * nx + x0
        # the end belongs to the next edge
        for start in range(0, max(steps, 1), PART):
            end = min(start + PART, max(steps, 1))
            middle = (start + end) >> 1
            if squares[np.uint64(first + middle * major + ((begin + middle * slope) >> FIXED) * minor)] > highest:
                for i in range(start, end):
                    highest = max(highest, flat[np.uint64(first + i * major + ((begin + i * slope) >> FIXED) * minor)])
        x0, y0 = x1, y1
    return np.int64(highest)


@kernel
def large_overlaps_lethal(flat, squares, nx, placed):
    """Return True if a polygon overlaps a lethal cell: as `overlaps_lethal`, without squares that contain none.

    `placed` (2, n): see `place_footprint`; `flat`, `squares`: see `large_edge_cost`.
    """
    left, right, low, high = placed[0, 0], placed[0, 0], placed[1, 0], placed[1, 0]
    for j in range(1, placed.shape[1]):
        left, right = min(left, placed[0, j]), max(right, placed[0, j])
        low, high = min(low, placed[1, j]), max(high, placed[1, j])
    x1, y1 = np.int64(right), np.int64(high)
    for iy in range(np.int64(low), y1 + 1, PART):
        to_y = min(iy + PART - 1, y1)
        for ix in range(np.int64(left), x1 + 1, PART):
            to_x = min(ix + PART - 1, x1)
            if squares[np.uint64(((iy + to_y) >> 1) * nx + ((ix + to_x) >> 1))] < 254:
                continue
            if not overlaps_box(placed, ix, iy, to_x + 1.0, to_y + 1.0):
                continue
            for y in range(iy, to_y + 1):
                for x in range(ix, to_x + 1):
                    if flat[np.uint64(y * nx + x)] == 254 and overlaps_cell(placed, x, y):
                        return True
    return False
