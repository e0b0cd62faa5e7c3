"""The footprint as the kernels of the search over poses see it."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from navstack.core import Footprint
from navstack.core.footprint import CIRCLE_VERTICES

STEP: Final = 0.3
"""Cells: largest motion of a point of the footprint between two checks.

Between them each point is within half of it of where it is at one of the checks, so a footprint that is padded by that much and
free at the checks is free everywhere. Where it is not free, the motion between two checks is checked again, with a finer
padding at finer steps.
"""
FINE: Final = (0.01, 0.002, 0.0)
"""Cells: fine paddings. The first one with which the robot fits at its start and its goal is used."""
FINEST_STEP: Final = 0.003
ROUND_STEP: Final = 0.5


class Shape(NamedTuple):
    """A footprint in cells."""

    corners: int
    """0 for a round robot: the costs of cells decide where its centre may be."""
    fine_corners: int
    rows: NDArray[np.float64]
    """(8, k): x and y of the padded corners, scratch of the kernels, and x and y of the finely padded corners."""
    reach: float
    """Circumscribed radius, padding included; 0 for a round robot."""
    step: float
    fine_step: float
    convex: bool


def is_round(footprint: Footprint | None) -> bool:
    """Whether a footprint is the polygon that stands for a circle (`robot_radius`)."""
    if footprint is None:
        return True
    return len(footprint.vertices) == CIRCLE_VERTICES and (
        footprint.circumscribed_radius - footprint.inscribed_radius
        < (1.0 - math.cos(math.pi / CIRCLE_VERTICES) + 1e-6) * footprint.circumscribed_radius
    )


def shape_of(footprint: Footprint | None, resolution: float, fine: float = FINE[0]) -> Shape:
    """The footprint in cells of `resolution` (m), padded by half of STEP, and by `fine` (cells)."""
    if footprint is None or is_round(footprint):
        return Shape(0, 0, np.zeros((8, 1)), 0.0, ROUND_STEP, ROUND_STEP, True)
    polygon = shapely.Polygon(footprint.vertices / resolution)
    padded, finely = _corners(polygon, 0.5 * STEP), _corners(polygon, fine)
    reach = max(float(np.hypot(*corners.T).max()) for corners in (padded, finely))
    convex = bool(abs(polygon.convex_hull.area - polygon.area) < 1e-9 * polygon.area)
    rows = np.zeros((8, max(len(padded), len(finely), math.ceil(2.0 * reach) + 4)))
    rows[:2, : len(padded)], rows[6:, : len(finely)] = padded.T, finely.T
    return Shape(len(padded), len(finely), rows, reach, STEP, max(FINEST_STEP, 1.4 * fine), convex)


def _corners(polygon: shapely.Polygon, padding: float) -> NDArray[np.float64]:
    """Corners (n, 2) of a padded polygon."""
    padded = polygon.buffer(padding, join_style="mitre", mitre_limit=3.0) if padding > 0.0 else polygon
    return np.asarray(padded.exterior.coords)[:-1]
