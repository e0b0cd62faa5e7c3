# pyright: basic
"""Exact distance from a footprint to the nearest obstacle."""

from __future__ import annotations

import math

import numpy as np

from navstack.core.jit import kernel
from navstack.sim._grid_kernels import free_around, segment_meets_square
from navstack.sim._polygon_kernels import polygon_contains, polygon_to_point, polygon_to_polygon

# tolerance above the rounding error of distances, m or cells
CLOSE = 1e-9


@kernel
def point_to_square(x, y, left, bottom):
    """Distance from the point to the unit square with that corner."""
    dx = max(left - x, 0.0, x - left - 1.0)
    dy = max(bottom - y, 0.0, y - bottom - 1.0)
    return math.sqrt(dx * dx + dy * dy)


@kernel
def polygon_to_square(polygon, left, bottom):
    """Distance from the polygon (n, 2), n = 1: a point, to the unit square with that corner."""
    n = polygon.shape[0]
    if n == 1:
        return point_to_square(polygon[0, 0], polygon[0, 1], left, bottom)
    j = n - 1
    for i in range(n):
        if segment_meets_square(polygon[j, 0], polygon[j, 1], polygon[i, 0], polygon[i, 1], left, bottom):
            return 0.0
        j = i
    if polygon_contains(polygon, left + 0.5, bottom + 0.5):
        return 0.0
    # disjoint: one of the two nearest points is a corner
    best = math.inf
    for i in range(n):
        best = min(best, point_to_square(polygon[i, 0], polygon[i, 1], left, bottom))
    for i in range(4):
        best = min(best, polygon_to_point(polygon, left + float(i & 1), bottom + float(i >> 1)))
    return best


@kernel
def clearance(squares, grid, discs, circles, corners, first, footprint, x, y, yaw):
    """Distance (m) from the footprint (n, 2) (robot frame, m; n = 1: a point) at a pose in the map; inf without obstacles.

    `discs` .. `first`: as in `Solids`. Skips obstacles that the footprint's circumscribed circle shows to be farther than the
    best so far; the tolerance `CLOSE` makes the result identical to the bit to that of testing all of them.
    """
    _, ny, nx = squares.shape
    n = footprint.shape[0]
    resolution = grid[3]
    placed = np.empty((n, 2))
    c, s = math.cos(grid[2]), math.sin(grid[2])
    gx = (c * (x - grid[0]) + s * (y - grid[1])) / resolution
    gy = (c * (y - grid[1]) - s * (x - grid[0])) / resolution
    c, s = math.cos(yaw - grid[2]), math.sin(yaw - grid[2])
    radius = 0.0
    for i in range(n):
        placed[i, 0] = gx + (c * footprint[i, 0] - s * footprint[i, 1]) / resolution
        placed[i, 1] = gy + (s * footprint[i, 0] + c * footprint[i, 1]) / resolution
        radius = max(radius, math.hypot(placed[i, 0] - gx, placed[i, 1] - gy))
    best = math.inf
    # rings of cells around the centre's cell, outwards, until none can be nearer
    ix, iy = math.floor(gx), math.floor(gy)
    farthest = max(max(abs(ix), abs(nx - 1 - ix)), max(abs(iy), abs(ny - 1 - iy)))
    ring = 0
    if 0 <= ix < nx and 0 <= iy < ny:
        ring = free_around(squares, ix, iy) + 1
    else:
        ring = max(max(-ix, ix - nx + 1), max(-iy, iy - ny + 1))
    while ring <= farthest and ring - 1 - radius < best:
        for row in range(max(iy - ring, 0), min(iy + ring, ny - 1) + 1):
            whole = row == iy - ring or row == iy + ring
            column = max(ix - ring, 0) if whole else ix - ring
            while column <= min(ix + ring, nx - 1):
                if column < 0:
                    column += 2 * ring
                    continue
                free = int(squares[0, row, column])  # number of free cells towards larger x
                if free == 0:
                    near = point_to_square(gx, gy, float(column), float(row)) - radius
                    if near <= best + CLOSE:
                        best = min(best, polygon_to_square(placed, float(column), float(row)))
                column += max(free, 1) if whole else max(2 * ring, 1)
        ring += 1
    best *= resolution
    radius *= resolution
    c, s = math.cos(yaw), math.sin(yaw)
    for k in range(discs.shape[0]):
        dx, dy = discs[k, 0] - x, discs[k, 1] - y
        away = math.hypot(dx, dy)
        if away - discs[k, 2] - radius > best + CLOSE:
            continue
        if n > 1:
            away = polygon_to_point(footprint, c * dx + s * dy, c * dy - s * dx)
        best = min(best, max(away - discs[k, 2], 0.0))
    for k in range(circles.shape[0]):
        if math.hypot(circles[k, 0] - x, circles[k, 1] - y) - circles[k, 2] - radius > best + CLOSE:
            continue
        for i in range(n):
            placed[i, 0] = x + c * footprint[i, 0] - s * footprint[i, 1]
            placed[i, 1] = y + s * footprint[i, 0] + c * footprint[i, 1]
        best = min(best, polygon_to_polygon(placed, corners[first[k] : first[k + 1]]))
    return best


@kernel
def clearances(squares, grid, discs, circles, corners, first, footprint, poses, out):
    """Writes the `clearance` at each of the `poses` (n, 3) into `out` (n,)."""
    for i in range(len(poses)):
        x, y, yaw = poses[i, 0], poses[i, 1], poses[i, 2]
        out[i] = clearance(squares, grid, discs, circles, corners, first, footprint, x, y, yaw)
