# pyright: basic
"""Collision tests of a footprint with the map and the solids. Solids are numbered: first the discs, then the polygons."""

from __future__ import annotations

import math

from navstack.core.jit import kernel
from navstack.sim._grid_kernels import polygon_on_cells
from navstack.sim._polygon_kernels import polygon_to_point, polygons_meet


@kernel
def choose_solids(solids, x, y, reach, chosen):
    """Writes the numbers of the solids within `reach` (m) of the point into `chosen`; returns their count."""
    count = 0
    discs, circles = solids.discs, solids.circles
    for k in range(discs.shape[0]):
        dx, dy, far = discs[k, 0] - x, discs[k, 1] - y, reach + discs[k, 2]
        if dx * dx + dy * dy < far * far:
            chosen[count] = k
            count += 1
    for k in range(circles.shape[0]):
        dx, dy, far = circles[k, 0] - x, circles[k, 1] - y, reach + circles[k, 2]
        if dx * dx + dy * dy < far * far:
            chosen[count] = discs.shape[0] + k
            count += 1
    return count


@kernel
def solid_collision(solids, number, footprint, radius, x, y, c, s, placed):
    """True if the footprint (n, 2) intersects the solid with that number; c and s are cosine and sine of its yaw.

    `radius` is the footprint's circumscribed radius (m), `placed` (n, 2) scratch memory.
    """
    discs, circles = solids.discs, solids.circles
    if number < discs.shape[0]:
        dx, dy, r = discs[number, 0] - x, discs[number, 1] - y, discs[number, 2]
        if dx * dx + dy * dy > (radius + r) * (radius + r):
            return False
        return polygon_to_point(footprint, c * dx + s * dy, c * dy - s * dx) < r
    k = number - discs.shape[0]
    dx, dy, r = circles[k, 0] - x, circles[k, 1] - y, circles[k, 2]
    if dx * dx + dy * dy > (radius + r) * (radius + r):
        return False
    for i in range(footprint.shape[0]):
        placed[i, 0] = x + c * footprint[i, 0] - s * footprint[i, 1]
        placed[i, 1] = y + s * footprint[i, 0] + c * footprint[i, 1]
    return polygons_meet(placed, solids.corners[solids.first[k] : solids.first[k + 1]])


@kernel
def find_collision(squares, grid, solids, chosen, count, footprint, radius, x, y, yaw, placed):
    """What the footprint (n, 2) at a pose in the map collides with: a cell index >= 0, a solid as -2 - number, -1 for nothing.

    Tests the first `count` solids of `chosen`. `radius` is the footprint's circumscribed radius (m), `placed` (n, 2) scratch
    memory.
    """
    resolution = grid[3]
    c, s = math.cos(grid[2]), math.sin(grid[2])
    gx = (c * (x - grid[0]) + s * (y - grid[1])) / resolution
    gy = (c * (y - grid[1]) - s * (x - grid[0])) / resolution
    c, s = math.cos(yaw - grid[2]), math.sin(yaw - grid[2])
    for i in range(footprint.shape[0]):
        placed[i, 0] = gx + (c * footprint[i, 0] - s * footprint[i, 1]) / resolution
        placed[i, 1] = gy + (s * footprint[i, 0] + c * footprint[i, 1]) / resolution
    cell = polygon_on_cells(squares, placed, gx, gy, radius / resolution)
    if cell >= 0:
        return cell
    c, s = math.cos(yaw), math.sin(yaw)
    for k in range(count):
        if solid_collision(solids, chosen[k], footprint, radius, x, y, c, s, placed):
            return -2 - chosen[k]
    return -1


@kernel
def distance_to_solid(solids, number, x, y):
    """Distance (m) from the point to the solid with that number, 0 inside."""
    discs = solids.discs
    if number < discs.shape[0]:
        return max(math.hypot(discs[number, 0] - x, discs[number, 1] - y) - discs[number, 2], 0.0)
    k = number - discs.shape[0]
    return polygon_to_point(solids.corners[solids.first[k] : solids.first[k + 1]], x, y)
