"""Convex parts of a polygon: costmap_2d fills convex polygons only, and fills the notches of others too."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def is_convex(vertices: NDArray[np.float64]) -> bool:
    """Return True if the polygon (n, 2) turns in one direction only."""
    turns = _turns(vertices)
    slack = 1e-12 * max(1.0, float(np.abs(turns).max(initial=0.0)))
    return bool((turns >= -slack).all() or (turns <= slack).all())


def convex_parts(vertices: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Return the polygon itself if it is convex, otherwise a triangulation of it, (3, 2) each, by ear clipping.

    The polygon must not cross itself (`Footprint` checks that).
    """
    polygon = np.array(vertices, np.float64)
    if is_convex(polygon):
        return [polygon]
    if _area(polygon) < 0.0:
        polygon = polygon[::-1].copy()
    left = list(range(len(polygon)))
    parts: list[NDArray[np.float64]] = []
    while len(left) > 3:
        ear = next((i for i in range(len(left)) if _is_ear(polygon, left, i)), None)
        if ear is None:  # the remaining corners are collinear
            break
        parts.append(polygon[[left[ear - 1], left[ear], left[(ear + 1) % len(left)]]])
        del left[ear]
    parts.append(polygon[left])
    return parts


def _turns(vertices: NDArray[np.float64]) -> NDArray[np.float64]:
    edges = np.roll(vertices, -1, axis=0) - vertices
    following = np.roll(edges, -1, axis=0)
    return edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0]


def _area(vertices: NDArray[np.float64]) -> float:
    x, y = vertices[:, 0], vertices[:, 1]
    return 0.5 * float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum())


def _is_ear(polygon: NDArray[np.float64], left: list[int], i: int) -> bool:
    """Return True if the corner turns left and its triangle with its neighbours contains no other corner."""
    a, b, c = polygon[left[i - 1]], polygon[left[i]], polygon[left[(i + 1) % len(left)]]
    if _side(a, b, c) <= 0.0:
        return False
    for k in left:
        p = polygon[k]
        if any(p is q or (p == q).all() for q in (a, b, c)):
            continue
        if _side(a, b, p) >= 0.0 and _side(b, c, p) >= 0.0 and _side(c, a, p) >= 0.0:
            return False
    return True


def _side(a: NDArray[np.float64], b: NDArray[np.float64], p: NDArray[np.float64]) -> float:
    return float((b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]))
