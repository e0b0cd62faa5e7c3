"""Areas of interest: which part of a map a picture shows (m)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from navstack.core import Bounds, GridGeometry


def area_of(points: Sequence[NDArray[np.float64]]) -> Bounds:
    """Returns the bounding box of the finite points among arrays (n, 2+)."""
    area = Bounds()
    for part in points:
        finite = part[np.isfinite(part[:, :2]).all(axis=1)]
        if len(finite):
            (x0, y0), (x1, y1) = finite[:, :2].min(axis=0), finite[:, :2].max(axis=0)
            area = area.union(Bounds(float(x0), float(y0), float(x1), float(y1)))
    return area


def shaped(area: Bounds, widest: float = 2.5, tallest: float = 1.4, least: float = 4.0) -> Bounds:
    """Grows an area about its centre until its aspect ratio and its sides suit a picture."""
    width, height = area.max_x - area.min_x, area.max_y - area.min_y
    new_width = max(width, height / tallest, least)
    new_height = max(height, width / widest, least)
    mx, my = (area.min_x + area.max_x) / 2.0, (area.min_y + area.max_y) / 2.0
    return Bounds(mx - new_width / 2.0, my - new_height / 2.0, mx + new_width / 2.0, my + new_height / 2.0)


def area_of_grid(geometry: GridGeometry) -> Bounds:
    """Returns the extent of a grid."""
    x0, x1, y0, y1 = geometry.extent
    return Bounds(x0, y0, x1, y1)
