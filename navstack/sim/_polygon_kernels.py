# pyright: basic
"""Polygons as arrays of corners (n, 2): containment, distance and intersection. Exact except for rounding."""

from __future__ import annotations

import math

from navstack.core.jit import kernel


@kernel
def polygon_contains(polygon, x, y):
    """True for a point inside the polygon (n, 2), by the even-odd rule."""
    inside = False
    j = polygon.shape[0] - 1
    for i in range(polygon.shape[0]):
        if (polygon[i, 1] > y) != (polygon[j, 1] > y):
            at = polygon[i, 0] + (y - polygon[i, 1]) / (polygon[j, 1] - polygon[i, 1]) * (polygon[j, 0] - polygon[i, 0])
            if x < at:
                inside = not inside
        j = i
    return inside


@kernel
def polygon_to_point(polygon, x, y):
    """Distance from the point to the polygon (n, 2), 0 inside."""
    if polygon_contains(polygon, x, y):
        return 0.0
    best = math.inf
    j = polygon.shape[0] - 1
    for i in range(polygon.shape[0]):
        ex, ey = polygon[i, 0] - polygon[j, 0], polygon[i, 1] - polygon[j, 1]
        wx, wy = x - polygon[j, 0], y - polygon[j, 1]
        length2 = ex * ex + ey * ey
        t = min(max((wx * ex + wy * ey) / length2, 0.0), 1.0) if length2 > 0.0 else 0.0
        best = min(best, (wx - t * ex) ** 2 + (wy - t * ey) ** 2)
        j = i
    return math.sqrt(best)


@kernel
def side_of(ax, ay, bx, by, x, y):
    """Twice the signed area of the triangle: positive for a point to the left of the line from a to b, 0 on it."""
    return (bx - ax) * (y - ay) - (by - ay) * (x - ax)


@kernel
def segments_meet(ax, ay, bx, by, cx, cy, dx, dy):
    """True if the segments ab and cd intersect, ends included."""
    if max(ax, bx) < min(cx, dx) or max(cx, dx) < min(ax, bx) or max(ay, by) < min(cy, dy) or max(cy, dy) < min(ay, by):
        return False
    c, d = side_of(ax, ay, bx, by, cx, cy), side_of(ax, ay, bx, by, dx, dy)
    if (c > 0.0 and d > 0.0) or (c < 0.0 and d < 0.0):
        return False
    a, b = side_of(cx, cy, dx, dy, ax, ay), side_of(cx, cy, dx, dy, bx, by)
    return not ((a > 0.0 and b > 0.0) or (a < 0.0 and b < 0.0))


@kernel
def polygons_meet(one, other):
    """True if the polygons (n, 2) and (m, 2) intersect, borders included."""
    j = one.shape[0] - 1
    for i in range(one.shape[0]):
        k = other.shape[0] - 1
        for m in range(other.shape[0]):
            if segments_meet(
                one[j, 0], one[j, 1], one[i, 0], one[i, 1], other[k, 0], other[k, 1], other[m, 0], other[m, 1]
            ):
                return True
            k = m
        j = i
    return polygon_contains(one, other[0, 0], other[0, 1]) or polygon_contains(other, one[0, 0], one[0, 1])


@kernel
def polygon_to_polygon(one, other):
    """Distance between the polygons (n, 2) and (m, 2), 0 if they intersect; `one` may be a single point."""
    if one.shape[0] == 1:
        return polygon_to_point(other, one[0, 0], one[0, 1])
    if polygons_meet(one, other):
        return 0.0
    # disjoint: one of the two nearest points is a corner
    best = math.inf
    for i in range(one.shape[0]):
        best = min(best, polygon_to_point(other, one[i, 0], one[i, 1]))
    for i in range(other.shape[0]):
        best = min(best, polygon_to_point(one, other[i, 0], other[i, 1]))
    return best
