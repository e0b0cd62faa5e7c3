"""Clearance of a path: its distance to the nearest obstacle, and the obstacles that it crosses."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core.costs import LETHAL
from navstack.core.grid import Bounds, Costmap

_PAIRS = 4_000_000
"""Pairs of parts of a path and cells: a path has 8 to 64 parts, of which only the ones near obstacles are searched by point."""


def clearance_along(costmap: Costmap, xy: NDArray[np.float64]) -> float:
    """Return the smallest distance (m) between the polyline `xy` (n, >= 2; costmap's frame) and the square of a lethal cell.

    0 inside a lethal cell, inf without lethal cells. The line is sampled at least every half cell, so the distance is exact to
    a quarter of a cell.
    """
    points = _resampled(np.asarray(xy, dtype=np.float64)[:, :2], 0.5 * costmap.geometry.resolution)
    g = costmap.geometry
    reach = max(1.0, 8.0 * g.resolution)
    while True:
        low, high = points.min(axis=0) - reach, points.max(axis=0) + reach
        window = g.window_of(Bounds(float(low[0]), float(low[1]), float(high[0]), float(high[1])))
        distance = _smallest_distance(
            costmap.data[window.slices] == LETHAL, points, g.resolution, *_corner(costmap, window.x0, window.y0)
        )
        if distance <= reach or window == g.window:
            return distance
        reach *= 4.0


def lethal_cells_along(costmap: Costmap, xy: NDArray[np.float64]) -> tuple[int, float]:
    """Return how many lethal cells the polyline `xy` (n, >= 2; costmap's frame) crosses, and after how many meters first.

    Exact: every cell of which the line has more than a point counts. (0, inf) without any.
    """
    g = costmap.geometry
    points = np.asarray(xy, dtype=np.float64)[:, :2]
    cells = (points - (g.origin_x, g.origin_y)) / g.resolution
    if len(points) == 1:
        points, cells = np.repeat(points, 2, axis=0), np.repeat(cells, 2, axis=0)
    crossed: set[tuple[int, int]] = set()
    first, driven = math.inf, 0.0
    for (a, b), (p, q) in zip(pairwise(cells), pairwise(points), strict=True):
        # where the segment crosses the lines of the grid; between two of these points it is in one cell
        at = [np.array([0.0, 1.0])]
        for begin, end in zip(a, b, strict=True):
            if begin != end:
                lines = np.arange(math.ceil(min(begin, end)), math.floor(max(begin, end)) + 1)
                at.append(np.clip((lines - begin) / (end - begin), 0.0, 1.0))
        t = np.unique(np.concatenate(at))
        middle = np.floor(a + (b - a) * (0.5 * (t[:-1] + t[1:]))[:, None]).astype(np.int64)
        inside = ((middle >= 0) & (middle < (g.nx, g.ny))).all(axis=1)
        lethal = np.zeros(len(middle), np.bool_)
        lethal[inside] = costmap.data[middle[inside, 1], middle[inside, 0]] == LETHAL
        length = float(np.hypot(*(q - p)))
        if lethal.any():
            first = min(first, driven + float(t[int(lethal.argmax())]) * length)
            crossed.update(map(tuple, middle[lethal].tolist()))
        driven += length
    return len(crossed), first


def _corner(costmap: Costmap, ix: int, iy: int) -> tuple[float, float]:
    g = costmap.geometry
    return g.origin_x + ix * g.resolution, g.origin_y + iy * g.resolution


def _smallest_distance(
    lethal: NDArray[np.bool_], points: NDArray[np.float64], resolution: float, left: float, bottom: float
) -> float:
    """Return the smallest distance from `points` to a square of `lethal`, whose corner is at (left, bottom)."""
    ys, xs = np.nonzero(lethal)
    if len(xs) == 0:
        return math.inf
    centers = np.empty((len(xs), 2))
    centers[:, 0], centers[:, 1] = left + (xs + 0.5) * resolution, bottom + (ys + 0.5) * resolution
    # In parts of the path: no point of a part is nearer to a square by more than its distance to the middle of the part.
    # A KDTree would do the same, but importing it takes longer than a plan.
    parts: list[_Part] = []
    pieces: list[NDArray[np.float64]] = np.array_split(points, min(len(points), max(8, min(64, _PAIRS // len(xs)))))
    for piece in pieces:
        middle = piece[len(piece) // 2]
        reach = float(np.hypot(*(piece - middle).T).max())
        parts.append(_Part(piece, middle, reach, float(_to_squares(middle, centers, resolution).min())))
    smallest = min(part.distance for part in parts)
    for part in sorted(parts, key=lambda part: part.distance - part.reach):
        if part.distance - part.reach >= smallest:
            break
        near = centers[_to_squares(part.middle, centers, resolution) - part.reach < smallest]
        smallest = min(smallest, *(float(_to_squares(point, near, resolution).min()) for point in part.points))
    return smallest


class _Part(NamedTuple):
    """Consecutive points of a path."""

    points: NDArray[np.float64]
    middle: NDArray[np.float64]
    reach: float
    """Largest distance of a point from the middle."""
    distance: float
    """Distance from the middle to the nearest square."""


def _to_squares(point: NDArray[np.float64], centers: NDArray[np.float64], side: float) -> NDArray[np.float64]:
    """(n,) distances from a point to the squares with these centers, 0 inside."""
    gap = np.maximum(np.abs(centers - point) - 0.5 * side, 0.0)
    return np.hypot(gap[:, 0], gap[:, 1])


def _resampled(points: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    pieces = [points[:1]]
    for a, b in pairwise(points):
        n = max(1, math.ceil(float(np.hypot(*(b - a))) / step))
        pieces.append(a + (b - a) * (np.arange(1, n + 1) / n)[:, None])
    return np.concatenate(pieces)
