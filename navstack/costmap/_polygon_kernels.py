# pyright: basic
"""The robot's footprint at a pose, and the cells of convex polygons."""

from __future__ import annotations

import math

from navstack.core.jit import kernel
from navstack.core.line_kernels import line_next, line_start


@kernel
def place_footprint(vertices, x, y, yaw, out, bounds):
    """Write the footprint `vertices` (n, 2) at a pose into `out`; grow `bounds` to contain it."""
    c, s = math.cos(yaw), math.sin(yaw)
    for i in range(vertices.shape[0]):
        wx = x + (vertices[i, 0] * c - vertices[i, 1] * s)
        wy = y + (vertices[i, 0] * s + vertices[i, 1] * c)
        out[i, 0], out[i, 1] = wx, wy
        bounds[0], bounds[1] = min(bounds[0], wx), min(bounds[1], wy)
        bounds[2], bounds[3] = max(bounds[2], wx), max(bounds[3], wy)


@kernel
def fill_convex(costs, vertices, first, last, spans, origin_x, origin_y, resolution, value):
    """Set the cells of a convex polygon: in each column, from the lowest to the highest cell of its edges.

    `vertices[first:last]` are the corners (m), `spans` (2, >= nx) is scratch. Returns False and sets nothing if a corner is
    outside the map (costmap_2d's setConvexPolygonCost).
    """
    ny, nx = costs.shape
    left, right = nx, -1
    for i in range(first, last):
        wx, wy = vertices[i, 0], vertices[i, 1]
        if not (wx >= origin_x and wy >= origin_y):
            return False
        fx, fy = (wx - origin_x) / resolution, (wy - origin_y) / resolution
        if not (fx < nx and fy < ny):
            return False
        left, right = min(left, int(fx)), max(right, int(fx))
    for x in range(left, right + 1):
        spans[0, x] = ny
        spans[1, x] = -1
    for i in range(first, last):
        j = i + 1 if i + 1 < last else first
        x0 = int((vertices[i, 0] - origin_x) / resolution)
        y0 = int((vertices[i, 1] - origin_y) / resolution)
        x1 = int((vertices[j, 0] - origin_x) / resolution)
        y1 = int((vertices[j, 1] - origin_y) / resolution)
        line = line_start(x0, y0, x1, y1, nx)
        cell, error = y0 * nx + x0, line[0] // 2
        for _ in range(line[0] + 1):
            y = cell // nx
            x = cell - y * nx
            spans[0, x] = min(spans[0, x], y)
            spans[1, x] = max(spans[1, x], y)
            cell, error = line_next(cell, error, line)
    for x in range(left, right + 1):
        for y in range(spans[0, x], spans[1, x] + 1):
            costs[y, x] = value
    return True
