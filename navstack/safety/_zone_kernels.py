# pyright: basic
"""Points and zones: which points are inside, how far they are, and whether a command brings them nearer.

A shape is a polygon `corners` (n, 2) in the base frame, counter-clockwise, or, with no corners, a circle of `radius` around the
base. Points (k, 2) are in the base frame.
"""

from __future__ import annotations

import math

from navstack.core.jit import kernel

# a point that gets nearer more slowly than this does not get nearer, m/s
NEARER = 1e-6
TINY = 1e-12
# a point deeper inside the robot must get out: noise and padding do not explain it, m
DEEP = 0.03


@kernel
def in_polygon(corners, x, y):
    """Return True if an odd number of edges cross the ray from the point along +x; edges are half open in y."""
    inside = False
    n = corners.shape[0]
    px, py = corners[n - 1, 0], corners[n - 1, 1]
    for i in range(n):
        qx, qy = corners[i, 0], corners[i, 1]
        if (py < y) != (qy < y) and px + (y - py) * (qx - px) / (qy - py) > x:
            inside = not inside
        px, py = qx, qy
    return inside


@kernel
def in_shape(corners, radius, x, y):
    """Return True if the point is inside the shape."""
    if corners.shape[0] == 0:
        return x * x + y * y < radius * radius
    return in_polygon(corners, x, y)


@kernel
def count_inside(points, corners, radius, reach, found):
    """Return the number of points in a shape; write the indices of the first ones to `found`.

    `reach`: no part of the shape is farther from the base (m).
    """
    count = 0
    limit = reach * reach
    for i in range(points.shape[0]):
        x, y = points[i, 0], points[i, 1]
        if x * x + y * y <= limit and in_shape(corners, radius, x, y):
            if count < found.shape[0]:
                found[count] = i
            count += 1
    return count


@kernel
def edge_distance(corners, x, y):
    """Return the distance from a point to the outline of a polygon and the nearest point there: distance, x, y, edge."""
    best, bx, by, edge = math.inf, 0.0, 0.0, 0
    n = corners.shape[0]
    px, py = corners[n - 1, 0], corners[n - 1, 1]
    for i in range(n):
        qx, qy = corners[i, 0], corners[i, 1]
        dx, dy = qx - px, qy - py
        length = dx * dx + dy * dy
        s = 0.0
        if length > 0.0:
            s = min(max(((x - px) * dx + (y - py) * dy) / length, 0.0), 1.0)
        cx, cy = px + s * dx, py + s * dy
        square = (x - cx) * (x - cx) + (y - cy) * (y - cy)
        if square < best:
            best, bx, by, edge = square, cx, cy, i
        px, py = qx, qy
    return math.sqrt(best), bx, by, edge


@kernel
def shape_distance(corners, radius, x, y):
    """Return the distance from a point to a shape, 0 inside (m)."""
    if corners.shape[0] == 0:
        return max(math.hypot(x, y) - radius, 0.0)
    if in_polygon(corners, x, y):
        return 0.0
    return edge_distance(corners, x, y)[0]


@kernel
def gets_nearer(corners, radius, x, y, vx, vy, w):
    """Return True if a command moves a point towards the outline of a shape; inside it, deeper, or if deep, not outwards.

    The rate of the distance is the velocity of the point relative to the robot along the normal of the outline.
    """
    if corners.shape[0] == 0:
        far = math.hypot(x, y)
        rate = -(x * vx + y * vy) / max(far, TINY)
        return rate < (NEARER if far < radius - DEEP else -NEARER)
    _, cx, cy, edge = edge_distance(corners, x, y)
    nx, ny = x - cx, y - cy
    size = math.hypot(nx, ny)
    inside = in_polygon(corners, x, y)
    deep = inside and size > DEEP
    if size < TINY:
        n = corners.shape[0]
        nx = corners[edge, 1] - corners[(edge + n - 1) % n, 1]
        ny = corners[(edge + n - 1) % n, 0] - corners[edge, 0]
        size = math.hypot(nx, ny)
    elif inside:
        nx, ny = -nx, -ny
    rate = (nx * (w * y - vx) - ny * (w * x + vy)) / size
    return rate < (NEARER if deep else -NEARER)


@kernel
def any_nearer(points, found, count, corners, radius, command):
    """Return the index of the first of the points `found[:count]` that the command (3,) brings nearer to a shape, or -1."""
    for k in range(count):
        i = found[k]
        if gets_nearer(corners, radius, points[i, 0], points[i, 1], command[0], command[1], command[2]):
            return i
    return -1


@kernel
def transform_points(points, pose, out):
    """Write points (k, 2) in a frame at `pose` (3,) to `out` (k, 2)."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for i in range(points.shape[0]):
        x, y = points[i, 0], points[i, 1]
        out[i, 0] = pose[0] + c * x - s * y
        out[i, 1] = pose[1] + s * x + c * y


@kernel
def scan_points(ranges, directions, range_min, range_max, out):
    """Write the points of the beams of a scan that hit something to the start of `out` (n, 2), sensor frame; return their number.

    `directions` (n, 2): cosine and sine of each beam. The second result is the number of valid beams: those, and the ones
    without a hit (REP 117: +inf). The third one is the number of beams that hit something nearer than `range_min` (-inf too);
    their directions fill the end of `out`. NaN says nothing about the beam.
    """
    count, valid, near = 0, 0, 0
    last = ranges.shape[0] - 1
    for i in range(ranges.shape[0]):
        r = ranges[i]
        if r < range_min:
            out[last - near, 0] = directions[i, 0]
            out[last - near, 1] = directions[i, 1]
            near += 1
        elif r >= range_min:
            valid += 1
            if r <= range_max and r < math.inf:
                out[count, 0] = r * directions[i, 0]
                out[count, 1] = r * directions[i, 1]
                count += 1
    return count, valid, near


@kernel
def cloud_points(points, min_height, max_height, min_range, out):
    """Write x and y of the points (n, 3) of a cloud within heights and beyond a range (m) to `out`; return their number."""
    count = 0
    square = min_range * min_range
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        if z >= min_height and z <= max_height and x * x + y * y >= square and abs(x) + abs(y) < math.inf:
            out[count, 0] = x
            out[count, 1] = y
            count += 1
    return count
