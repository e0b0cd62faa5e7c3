"""How near a path comes to obstacles."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from navstack.core.costs import LETHAL
from navstack.core.grid import Bounds, Costmap

_FEW_PAIRS = 2_000_000
"""Pairs of points and cells that are compared one by one (about 30 ms)."""


def clearance_along(costmap: Costmap, xy: NDArray[np.float64]) -> float:
    """Smallest distance (m) between the polyline `xy` (n, 2 or more columns; costmap's frame) and a lethal cell's square.

    0 inside a lethal cell, inf when the costmap has none. The line is looked at every half cell at least, so the distance
    is exact to a quarter of a cell.
    """
    points = _densified(np.asarray(xy, dtype=np.float64)[:, :2], 0.5 * costmap.geometry.resolution)
    g = costmap.geometry
    reach = max(1.0, 8.0 * g.resolution)
    while True:
        low, high = points.min(axis=0) - reach, points.max(axis=0) + reach
        window = g.window_of(Bounds(float(low[0]), float(low[1]), float(high[0]), float(high[1])))
        distance = _least(
            costmap.data[window.slices] == LETHAL, points, g.resolution, *_corner(costmap, window.x0, window.y0)
        )
        if distance <= reach or window == g.window:
            return distance
        reach *= 4.0


def _corner(costmap: Costmap, ix: int, iy: int) -> tuple[float, float]:
    g = costmap.geometry
    return g.origin_x + ix * g.resolution, g.origin_y + iy * g.resolution


def _least(
    lethal: NDArray[np.bool_], points: NDArray[np.float64], resolution: float, left: float, bottom: float
) -> float:
    """Distance of the nearest of `points` to the nearest square of `lethal`, whose corner lies at (left, bottom)."""
    ys, xs = np.nonzero(lethal)
    if len(xs) == 0:
        return math.inf
    centres = np.column_stack([left + (xs + 0.5) * resolution, bottom + (ys + 0.5) * resolution])
    if len(points) * len(centres) <= _FEW_PAIRS:
        gap = np.maximum(np.abs(centres[None] - points[:, None]) - 0.5 * resolution, 0.0)
        return float(np.hypot(gap[..., 0], gap[..., 1]).min())
    from scipy.spatial import KDTree  # takes longer to import than a few pairs to compare

    tree = KDTree(centres)
    distances, _ = tree.query(points)
    # a square is at most half a diagonal nearer than its centre, and at least half a side
    near = points[distances <= distances.min() + 0.21 * resolution + 1e-9]
    least = math.inf
    for point in near:
        around = centres[tree.query_ball_point(point, float(distances.min()) + 0.42 * resolution + 1e-9)]
        if len(around):
            gap = np.maximum(np.abs(around - point) - 0.5 * resolution, 0.0)
            least = min(least, float(np.hypot(gap[:, 0], gap[:, 1]).min()))
    return least


def _densified(points: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    pieces = [points[:1]]
    for a, b in pairwise(points):
        n = max(1, math.ceil(float(np.hypot(*(b - a))) / step))
        pieces.append(a + (b - a) * (np.arange(1, n + 1) / n)[:, None])
    return np.concatenate(pieces)
