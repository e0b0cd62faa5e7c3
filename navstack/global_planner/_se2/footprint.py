"""The footprint as the kernels of the search over poses see it."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from navstack.core import Footprint

STEP: Final = 0.3
"""Cells: largest motion of a point of the footprint between two samples of a primitive."""
PADDINGS: Final = (0.15, 0.6, 2.2)
"""Cells: a footprint that is padded by this much and free at a pose is free wherever no point of it moves farther.

A check with the largest padding covers most of a motion at once; where it fails, smaller ones follow, and last a fine one.
"""
FINE: Final = (0.01, 0.002, 0.0)
"""Cells: fine paddings. The first one with which the robot fits at its start and its goal is used."""
FINEST_STEP: Final = 0.003
ROUND_STEP: Final = 0.5


class Shape(NamedTuple):
    """A footprint in cells."""

    corners: int
    """0 for a round robot: the costs of cells decide where its centre may be."""
    rows: NDArray[np.float64]
    """(6 + 2 levels, k): number of corners and padding per level, four rows of scratch, then x and y of the corners per level.

    Level 0 has the fine padding, the others have PADDINGS.
    """
    reach: float
    """Circumscribed radius, the first of PADDINGS included; 0 for a round robot."""
    step: float
    fine_step: float
    convex: bool


def shape_of(footprint: Footprint | None, resolution: float, fine: float = FINE[0]) -> Shape:
    """The footprint in cells of `resolution` (m), padded by `fine` (cells), and by PADDINGS."""
    if footprint is None or footprint.is_round:
        return _ROUND
    shape = _polygon(footprint, resolution, fine)
    return shape._replace(rows=shape.rows.copy())  # the kernels write to it


@lru_cache(maxsize=32)
def _polygon(footprint: Footprint, resolution: float, fine: float) -> Shape:
    polygon = shapely.Polygon(footprint.vertices / resolution)
    levels = [_corners(polygon, padding) for padding in (fine, *PADDINGS)]
    far = max(float(np.hypot(*corners.T).max()) for corners in levels)
    convex = bool(abs(polygon.convex_hull.area - polygon.area) < 1e-9 * polygon.area)
    width = max(*(len(corners) for corners in levels), math.ceil(2.0 * far) + 4)
    rows = np.zeros((6 + 2 * len(levels), width))
    for level, (corners, padding) in enumerate(zip(levels, (fine, *PADDINGS), strict=True)):
        rows[0, level], rows[1, level] = len(corners), padding
        rows[6 + 2 * level : 8 + 2 * level, : len(corners)] = corners.T
    reach = float(np.hypot(*levels[1].T).max())
    return Shape(len(levels[0]), rows, reach, STEP, max(FINEST_STEP, 1.4 * fine), convex)


def _corners(polygon: shapely.Polygon, padding: float) -> NDArray[np.float64]:
    """Corners (n, 2) of a padded polygon."""
    padded = polygon.buffer(padding, join_style="mitre", mitre_limit=3.0) if padding > 0.0 else polygon
    return np.asarray(padded.exterior.coords)[:-1]


_ROUND: Final = Shape(0, np.zeros((6, 1)), 0.0, ROUND_STEP, ROUND_STEP, True)
