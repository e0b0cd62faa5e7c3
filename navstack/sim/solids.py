"""The obstacles of the world that are not on the map, at one time, as discs and polygons in the form that the kernels take."""
# pyright: reportMissingParameterType=false, reportUnknownParameterType=false
# numba infers the types of the kernels' arguments

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import kernel, plain_kernel


class SolidGeometry(NamedTuple):
    """Positions and outlines of `Solids`, without their heights; the argument of the kernels."""

    discs: NDArray[np.float64]
    circles: NDArray[np.float64]
    corners: NDArray[np.float64]
    first: NDArray[np.int64]


class Solids(NamedTuple):
    """Discs and polygons in the map frame (m) at one time. Read-only.

    Solids are numbered: first the discs, then the polygons.
    """

    discs: NDArray[np.float64]
    """(k, 3) x, y, radius; x and y are NaN while a disc is absent."""
    circles: NDArray[np.float64]
    """(p, 3) x, y, radius of a bounding circle of each polygon."""
    corners: NDArray[np.float64]
    """(m, 2) corners of all polygons, concatenated."""
    first: NDArray[np.int64]
    """(p + 1,) index of each polygon's first corner; the last entry is m."""
    tops: NDArray[np.float64]
    """(k + p,) heights of discs and polygons (m): a lidar or sonar mounted higher does not see them."""

    @property
    def geometry(self) -> SolidGeometry:
        """The solids without their heights."""
        return SolidGeometry(self.discs, self.circles, self.corners, self.first)

    @property
    def disc_tops(self) -> NDArray[np.float64]:
        """(k,) heights of the discs."""
        return self.tops[: len(self.discs)]

    @property
    def polygon_tops(self) -> NDArray[np.float64]:
        """(p,) heights of the polygons."""
        return self.tops[len(self.discs) :]

    def polygon(self, k: int) -> NDArray[np.float64]:
        """Returns the corners (n, 2) of polygon `k`."""
        return self.corners[self.first[k] : self.first[k + 1]]


def solids_from_discs(discs: NDArray[np.float64], tops: NDArray[np.float64]) -> Solids:
    """Returns solids without polygons."""
    return Solids(discs, np.empty((0, 3)), np.empty((0, 2)), np.zeros(1, np.int64), tops)


def concatenate_solids(parts: Sequence[Solids]) -> Solids:
    """Concatenates the discs of all parts, and their polygons."""
    if len(parts) == 1:
        return parts[0]
    lengths = np.concatenate([np.diff(part.first) for part in parts])
    return Solids(
        np.concatenate([part.discs for part in parts]),
        np.concatenate([part.circles for part in parts]),
        np.concatenate([part.corners for part in parts]),
        np.concatenate((np.zeros(1, np.int64), np.cumsum(lengths, dtype=np.int64))),
        np.concatenate([*(part.disc_tops for part in parts), *(part.polygon_tops for part in parts)]),
    )


# --- polygons -----------------------------------------------------------------------------------------------------------
# Arrays of corners (n, 2): containment, distance and intersection, exact except for rounding; and their placement.


@plain_kernel
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


@plain_kernel
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


@plain_kernel
def side_of(ax, ay, bx, by, x, y):
    """Twice the signed area of the triangle: positive for a point to the left of the line from a to b, 0 on it."""
    return (bx - ax) * (y - ay) - (by - ay) * (x - ax)


@plain_kernel
def segments_meet(ax, ay, bx, by, cx, cy, dx, dy):
    """True if the segments ab and cd intersect, ends included."""
    if max(ax, bx) < min(cx, dx) or max(cx, dx) < min(ax, bx) or max(ay, by) < min(cy, dy) or max(cy, dy) < min(ay, by):
        return False
    c, d = side_of(ax, ay, bx, by, cx, cy), side_of(ax, ay, bx, by, dx, dy)
    if (c > 0.0 and d > 0.0) or (c < 0.0 and d < 0.0):
        return False
    a, b = side_of(cx, cy, dx, dy, ax, ay), side_of(cx, cy, dx, dy, bx, by)
    return not ((a > 0.0 and b > 0.0) or (a < 0.0 and b < 0.0))


@plain_kernel
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


@plain_kernel
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


@kernel
def place_polygons(outlines, first, centers, poses):
    """Corners (m, 2) and bounding circles (p, 3) x, y, radius, in the map (m), of p polygons at `poses` (p, 3).

    `outlines` (m, 2): corners in the polygons' own frames, those of polygon k at `first[k]` .. `first[k + 1] - 1`; `centers`
    (p, 3): a bounding circle of each in its own frame.
    """
    corners = np.empty_like(outlines)
    circles = np.empty_like(centers)
    for k in range(centers.shape[0]):
        c, s = math.cos(poses[k, 2]), math.sin(poses[k, 2])
        for i in range(first[k], first[k + 1]):
            corners[i, 0] = poses[k, 0] + c * outlines[i, 0] - s * outlines[i, 1]
            corners[i, 1] = poses[k, 1] + s * outlines[i, 0] + c * outlines[i, 1]
        circles[k, 0] = poses[k, 0] + c * centers[k, 0] - s * centers[k, 1]
        circles[k, 1] = poses[k, 1] + s * centers[k, 0] + c * centers[k, 1]
        circles[k, 2] = centers[k, 2]
    return corners, circles


def pack_outlines(
    outlines: Sequence[NDArray[np.float64]],
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]:
    """Concatenates outlines: corners (m, 2), index of each first corner (p + 1,), bounding circles (p, 3) x, y, radius."""
    first = np.cumsum([0, *(len(outline) for outline in outlines)], dtype=np.int64)
    circles = np.empty((len(outlines), 3))
    for k, outline in enumerate(outlines):
        center = 0.5 * (outline.min(axis=0) + outline.max(axis=0))
        # margin for the rounding of the corners when the polygon is placed
        circles[k] = *center, float(np.hypot(*(outline - center).T).max()) * (1.0 + 1e-9) + 1e-9
    return np.concatenate([np.empty((0, 2)), *outlines]), first, circles
