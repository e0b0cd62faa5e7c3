# pyright: basic
"""Beams too near to measure: where their obstacle may be, and whether a command moves the robot towards it.

A shape is a polygon `corners` (n, 2) in the base frame, counter-clockwise, or, with no corners, a circle of `radius` around the
base.
"""

from __future__ import annotations

import math

from navstack.core.jit import kernel
from navstack.safety._zone_kernels import TINY, edge_distance, gets_nearer, in_polygon, in_shape


@kernel
def inscribed_radius(corners):
    """Return the radius of the largest circle around the base inside a polygon, 0 if the base is outside (m)."""
    return edge_distance(corners, 0.0, 0.0)[0] if in_polygon(corners, 0.0, 0.0) else 0.0


@kernel
def crossing(corners, radius, x, y, dx, dy):
    """Return the distance (m) from (x, y) to the outline of a shape along the unit vector (dx, dy); inf if it is not met."""
    best = math.inf
    n = corners.shape[0]
    if n == 0:
        b = x * dx + y * dy
        rest = b * b - (x * x + y * y - radius * radius)
        if rest >= 0.0:
            half = math.sqrt(rest)
            best = -b - half if -b - half >= 0.0 else -b + half
        return best if best >= 0.0 else math.inf
    px, py = corners[n - 1, 0], corners[n - 1, 1]
    for i in range(n):
        qx, qy = corners[i, 0], corners[i, 1]
        ex, ey = qx - px, qy - py
        cross = dx * ey - dy * ex
        if abs(cross) > TINY:
            ax, ay = px - x, py - y
            t = (ax * ey - ay * ex) / cross
            s = (ax * dy - ay * dx) / cross
            if t >= 0.0 and s >= -TINY and s <= 1.0 + TINY:
                best = min(best, t)
        px, py = qx, qy
    return best


@kernel
def beam_span(corners, radius, x, y, dx, dy, length):
    """Return where the obstacle of a beam may be, from and to (m along it): outside a shape, up to `length` or its outline."""
    edge = crossing(corners, radius, x, y, dx, dy)
    if in_shape(corners, radius, x, y) and edge < math.inf:
        return edge, max(edge, length)
    return 0.0, min(edge, length)


@kernel
def beam_ahead(sensor, directions, length, corners, radius, command, found):
    """Return the index of the first beam to whose obstacle the command (3,) moves a shape, or -1; write the place to `found`.

    `sensor` (2,), `directions` (k, 2) unit vectors, `found` (1, 2).
    """
    x, y = sensor[0], sensor[1]
    for i in range(directions.shape[0]):
        dx, dy = directions[i, 0], directions[i, 1]
        first, last = beam_span(corners, radius, x, y, dx, dy, length)
        for k in range(3):
            r = first + 0.5 * k * (last - first)
            px, py = x + r * dx, y + r * dy
            if gets_nearer(corners, radius, px, py, command[0], command[1], command[2]):
                found[0, 0], found[0, 1] = px, py
                return i
    return -1
