# pyright: basic
"""Which footprints overlap lethal cells, for many footprints among few lethal cells."""

from __future__ import annotations

import math

import numpy as np

from navstack.core.footprint_kernels import overlaps_cell, place_footprint
from navstack.core.jit import kernel

SLACK = 0.72
"""Cells: half the diagonal of a cell, and rounding in single precision."""
UNKNOWN, NEAR, FAR = 0, 1, 2
"""Whether the footprints of a class can reach a lethal cell: see `reach_of_class`."""
SECTORS = 256
SECTORS_PER_RADIAN = SECTORS / (2.0 * math.pi)


@kernel
def outline_cells(costs, box, xs, ys):
    """Write the centres of lethal cells in the box x0, y0, x1, y1 (half-open) to `xs`, `ys` (float32), relative to (x0, y0).

    Cells without a neighbour in the box that is not lethal are left out: a polygon that overlaps one of them overlaps another
    lethal cell too, or has all its corners in lethal cells. Returns their number, -1 if there are more than fit.
    """
    x0, y0, x1, y1 = box
    number = 0
    for iy in range(y0, y1):
        row = costs[iy, x0:x1]
        lethal = 0
        for i in range(np.uint64(x1 - x0)):
            lethal += row[i] == 254
        if lethal == 0:
            continue
        for ix in range(x0, x1):
            if costs[iy, ix] != 254:
                continue
            enclosed = ix > x0 and iy > y0 and ix + 1 < x1 and iy + 1 < y1
            if enclosed:
                for dy in range(-1, 2):
                    for dx in range(-1, 2):
                        enclosed = enclosed and costs[iy + dy, ix + dx] == 254
            if enclosed:
                continue
            if number == len(xs):
                return -1
            xs[number], ys[number] = ix - x0 + 0.5, iy - y0 + 0.5
            number += 1
    return number


@kernel
def outer_planes(vertices, resolution, planes):
    """Write the edges of a polygon that have all vertices on one side as half-planes to `planes` (n, 3); return their number.

    Unit normal pointing outwards, distance from the origin (cells). Their intersection contains the polygon.
    """
    number = 0
    for j in range(len(vertices)):
        before = len(vertices) - 1 if j == 0 else j - 1
        x, y = vertices[before, 0], vertices[before, 1]
        dx, dy = vertices[j, 0] - x, vertices[j, 1] - y
        length = np.hypot(dx, dy)
        if length == 0.0:
            continue
        left, right = 0.0, 0.0
        for i in range(len(vertices)):
            side = (dx * (vertices[i, 1] - y) - dy * (vertices[i, 0] - x)) / length
            left, right = max(left, side), max(right, -side)
        if min(left, right) > 1e-9:
            continue
        sign = 1.0 if left >= right else -1.0  # the polygon is on the left of the edge
        planes[number, 0], planes[number, 1] = sign * dy / length, -sign * dx / length
        planes[number, 2] = (planes[number, 0] * x + planes[number, 1] * y) / resolution + 1e-6
        number += 1
    return number


@kernel
def cells_within(cells, planes, pose, slack):
    """Write for each cell the largest distance outside one of the half-planes of a footprint; return how many are within `slack`.

    `cells`: xs, ys and distances (float32). `pose`: x, y (cells, relative to those of the cells), cosine, sine, scale.
    """
    xs, ys, distances = cells
    x, y, c, s, scale = pose
    for j in range(len(planes)):
        a = np.float32(planes[j, 0] * c - planes[j, 1] * s)
        b = np.float32(planes[j, 0] * s + planes[j, 1] * c)
        d = np.float32(x * a + y * b + scale * planes[j, 2])
        for i in range(np.uint64(len(xs))):
            outside = xs[i] * a + ys[i] * b - d
            distances[i] = outside if j == 0 else max(distances[i], outside)
    limit = np.float32(slack)
    found = 0
    for i in range(np.uint64(len(xs))):
        found += distances[i] <= limit
    return found


@kernel
def reach_of_class(cells, planes, pose, radius):
    """Return NEAR if a footprint of a class can reach one of the `cells`, else FAR.

    A class is a cell of the centre and one of SECTORS ranges of the heading. `pose`: x, y, heading (rad) of a member, largest
    scale; `radius`: of the footprint at this scale (cells).
    """
    x, y, yaw, scale = pose
    middle = (math.floor(yaw * SECTORS_PER_RADIAN) + 0.5) / SECTORS_PER_RADIAN
    centre = math.floor(x) + 0.5, math.floor(y) + 0.5, math.cos(middle), math.sin(middle), scale
    # half a cell, and what the footprint moves from the middle of the class to its border
    slack = 2.0 * SLACK + 0.5 / SECTORS_PER_RADIAN * (radius + 2.0 * SLACK)
    return NEAR if cells_within(cells, planes, centre, slack) > 0 else FAR


@kernel
def overlaps_outline(costs, settings, corners, pose, cells, area, placed):
    """Return True if a footprint at `pose` (m, m, rad) overlaps one of the `cells` that are within SLACK of it.

    `corners` (2, n): scaled. `cells`: see `cells_within`, relative to the first cell of `area`. `placed` (2, n) is scratch.
    """
    xs, ys, distances = cells
    origin_x, origin_y, resolution = settings.origin_x, settings.origin_y, settings.resolution
    place_footprint(costs, origin_x, origin_y, resolution, corners, pose[0], pose[1], pose[2], placed)
    for i in range(len(xs)):
        if distances[i] <= np.float32(SLACK) and overlaps_cell(placed, int(xs[i]) + area[0], int(ys[i]) + area[1]):
            return True
    return False
