"""What a footprint collides with, and its exact distance from the nearest obstacle."""
# pyright: reportMissingParameterType=false, reportUnknownParameterType=false
# numba infers the types of the kernels' arguments

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from navstack.core import Pose2D, kernel, plain_kernel
from navstack.sim.map_cells import free_around, is_free_around, polygon_on_cells, segment_meets_square
from navstack.sim.solids import polygon_contains, polygon_to_point, polygon_to_polygon, polygons_meet


@dataclass(frozen=True, slots=True)
class Collision:
    """The robot collided with an obstacle; counted once until the robot has left it."""

    time: float
    """Seconds."""
    pose: Pose2D
    """Pose of the robot in the map where it was stopped."""
    kind: str
    """`map`, `disc`, `polygon` or `robot`."""
    index: int
    """Index of the cell (iy * nx + ix), of the disc, of the polygon, or of the robot in its `Lockstep`."""
    at: tuple[float, float]
    """Center of the obstacle in the map (m)."""
    name: str = ""
    """Name of the shape, if it has one, or of the robot."""


# --- collision --------------------------------------------------------------------------------------------------------
# Solids are numbered: first the discs, then the polygons.


@plain_kernel
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


@plain_kernel
def is_near_solid(solids, number, radius, x, y):
    """True if the circle of `radius` (m) around the point meets the bounding circle of the solid with that number."""
    k = number - solids.discs.shape[0]
    circle = solids.discs[number] if k < 0 else solids.circles[k]
    dx, dy, far = circle[0] - x, circle[1] - y, radius + circle[2]
    return dx * dx + dy * dy <= far * far  # False for a disc that is absent


@plain_kernel
def solid_collision(solids, number, footprint, x, y, c, s, placed):
    """True if the footprint (n, 2) intersects the solid with that number, which it is near; c, s: cosine and sine of its yaw.

    `placed` (n, 2) is scratch memory.
    """
    k = number - solids.discs.shape[0]
    if k < 0:
        dx, dy = solids.discs[number, 0] - x, solids.discs[number, 1] - y
        return polygon_to_point(footprint, c * dx + s * dy, c * dy - s * dx) < solids.discs[number, 2]
    for i in range(footprint.shape[0]):
        placed[i, 0] = x + c * footprint[i, 0] - s * footprint[i, 1]
        placed[i, 1] = y + s * footprint[i, 0] + c * footprint[i, 1]
    return polygons_meet(placed, solids.corners[solids.first[k] : solids.first[k + 1]])


@plain_kernel
def find_collision(squares, grid, solids, chosen, count, footprint, radius, x, y, yaw, placed):
    """What the footprint (n, 2) at a pose in the map collides with: a cell index >= 0, a solid as -2 - number, -1 for nothing.

    Tests the first `count` solids of `chosen`. `radius` is the footprint's circumscribed radius (m), `placed` (n, 2) scratch
    memory.
    """
    resolution = grid[3]
    c, s = math.cos(grid[2]), math.sin(grid[2])
    gx = (c * (x - grid[0]) + s * (y - grid[1])) / resolution
    gy = (c * (y - grid[1]) - s * (x - grid[0])) / resolution
    # the free square at the center often covers the bounding circle; most poses then need no direction
    if not is_free_around(squares, gx, gy, radius / resolution):
        c, s = math.cos(yaw - grid[2]), math.sin(yaw - grid[2])
        for i in range(footprint.shape[0]):
            placed[i, 0] = gx + (c * footprint[i, 0] - s * footprint[i, 1]) / resolution
            placed[i, 1] = gy + (s * footprint[i, 0] + c * footprint[i, 1]) / resolution
        cell = polygon_on_cells(squares, placed)
        if cell >= 0:
            return cell
    c, s, has_direction = 1.0, 0.0, False
    for k in range(count):
        if not is_near_solid(solids, chosen[k], radius, x, y):
            continue
        if not has_direction:
            c, s, has_direction = math.cos(yaw), math.sin(yaw), True
        if solid_collision(solids, chosen[k], footprint, x, y, c, s, placed):
            return -2 - chosen[k]
    return -1


@plain_kernel
def distance_to_solid(solids, number, x, y):
    """Distance (m) from the point to the solid with that number, 0 inside."""
    discs = solids.discs
    if number < discs.shape[0]:
        return max(math.hypot(discs[number, 0] - x, discs[number, 1] - y) - discs[number, 2], 0.0)
    k = number - discs.shape[0]
    return polygon_to_point(solids.corners[solids.first[k] : solids.first[k + 1]], x, y)


# --- clearance --------------------------------------------------------------------------------------------------------


# tolerance above the rounding error of distances, m or cells
CLOSE = 1e-9


@plain_kernel
def point_to_square(x, y, left, bottom):
    """Distance from the point to the unit square with that corner."""
    dx = max(left - x, 0.0, x - left - 1.0)
    dy = max(bottom - y, 0.0, y - bottom - 1.0)
    return math.sqrt(dx * dx + dy * dy)


@plain_kernel
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
    c, s = math.cos(yaw), math.sin(yaw)
    best, reach = math.inf, radius * resolution
    # the footprint is at most as far as its center, if that lies within it
    limit = best
    if n == 1 or polygon_contains(footprint, 0.0, 0.0):
        for k in range(discs.shape[0]):
            dx, dy = discs[k, 0] - x, discs[k, 1] - y
            limit = min(limit, max(math.sqrt(dx * dx + dy * dy) - discs[k, 2], 0.0))
    for k in range(discs.shape[0]):
        dx, dy, far = discs[k, 0] - x, discs[k, 1] - y, min(limit, best) + CLOSE + discs[k, 2] + reach
        if not dx * dx + dy * dy <= far * far:  # too far, or absent
            continue
        away = math.hypot(dx, dy)
        if n > 1:
            away = polygon_to_point(footprint, c * dx + s * dy, c * dy - s * dx)
        best = min(best, max(away - discs[k, 2], 0.0))
    in_map = np.empty((n, 2))
    for k in range(circles.shape[0]):
        if math.hypot(circles[k, 0] - x, circles[k, 1] - y) - circles[k, 2] - reach > best + CLOSE:
            continue
        for i in range(n):
            in_map[i, 0] = x + c * footprint[i, 0] - s * footprint[i, 1]
            in_map[i, 1] = y + s * footprint[i, 0] + c * footprint[i, 1]
        best = min(best, polygon_to_polygon(in_map, corners[first[k] : first[k + 1]]))
    # cells last, for solids are often nearer: rings around the center's cell, outwards, until none can be nearer
    nearest = best / resolution + CLOSE
    ix, iy = math.floor(gx), math.floor(gy)
    farthest = max(max(abs(ix), abs(nx - 1 - ix)), max(abs(iy), abs(ny - 1 - iy)))
    ring = 0
    if 0 <= ix < nx and 0 <= iy < ny:
        ring = free_around(squares, ix, iy) + 1
    else:
        ring = max(max(-ix, ix - nx + 1), max(-iy, iy - ny + 1))
    while ring <= farthest and ring - 1 - radius < nearest:
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
                    if near <= nearest + CLOSE:
                        nearest = min(nearest, polygon_to_square(placed, float(column), float(row)))
                column += max(free, 1) if whole else max(2 * ring, 1)
        ring += 1
    return min(best, nearest * resolution)


@kernel
def clearances(squares, grid, discs, circles, corners, first, footprint, poses, out):
    """Writes the `clearance` at each of the `poses` (n, 3) into `out` (n,)."""
    for i in range(len(poses)):
        x, y, yaw = poses[i, 0], poses[i, 1], poses[i, 2]
        out[i] = clearance(squares, grid, discs, circles, corners, first, footprint, x, y, yaw)


@kernel
def find_near(points, reach, samples, squares, grid, solids, found):
    """Sets `found` (n,) for the points (n, 2) (m, map frame) within `reach` (m) of an occupied cell or of one of the `solids`.

    Occupied cells are looked for at the `samples` (m, 2) (m) around a point.
    """
    _, ny, nx = squares.shape
    resolution = grid[3]
    c, s = math.cos(grid[2]), math.sin(grid[2])
    margin = math.ceil(reach / resolution)
    discs, circles = solids.discs, solids.circles
    left, right, low, high = math.inf, -math.inf, math.inf, -math.inf
    for i in range(points.shape[0]):
        left, right = min(left, points[i, 0]), max(right, points[i, 0])
        low, high = min(low, points[i, 1]), max(high, points[i, 1])
    chosen = np.empty(discs.shape[0] + circles.shape[0], np.int64)
    around = 0.5 * math.hypot(right - left, high - low) + reach
    count = choose_solids(solids, 0.5 * (left + right), 0.5 * (low + high), around, chosen)
    for i in range(points.shape[0]):
        x, y = points[i, 0], points[i, 1]
        is_near = False
        for j in range(count):
            k = chosen[j] - discs.shape[0]
            if is_near or not is_near_solid(solids, chosen[j], reach, x, y):
                continue
            is_near = k < 0 or polygon_to_point(solids.corners[solids.first[k] : solids.first[k + 1]], x, y) < reach
        u, v = c * (x - grid[0]) + s * (y - grid[1]), c * (y - grid[1]) - s * (x - grid[0])
        gx, gy = u / resolution, v / resolution
        is_open = 0.0 <= gx < nx and 0.0 <= gy < ny and free_around(squares, int(gx), int(gy)) >= margin
        for k in range(0 if is_near or is_open else samples.shape[0]):
            gx, gy = (u + samples[k, 0]) / resolution, (v + samples[k, 1]) / resolution
            if 0.0 <= gx < nx and 0.0 <= gy < ny and squares[0, int(gy), int(gx)] == 0:
                is_near = True
                break
        found[i] = is_near
