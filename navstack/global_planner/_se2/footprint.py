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
free at the checks is free everywhere.
"""
ROUND_STEP: Final = 0.5


class Shape(NamedTuple):
    """A footprint in cells."""

    corners: int
    """0 for a round robot: the costs of cells decide where its centre may be."""
    rows: NDArray[np.float64]
    """(6, k): x and y of the padded corners, and scratch of the kernels."""
    reach: float
    """Circumscribed radius, padding included; 0 for a round robot."""
    step: float
    convex: bool


def is_round(footprint: Footprint | None) -> bool:
    """Whether a footprint is the polygon that stands for a circle (`robot_radius`)."""
    if footprint is None:
        return True
    return len(footprint.vertices) == CIRCLE_VERTICES and (
        footprint.circumscribed_radius - footprint.inscribed_radius
        < (1.0 - math.cos(math.pi / CIRCLE_VERTICES) + 1e-6) * footprint.circumscribed_radius
    )


def shape_of(footprint: Footprint | None, resolution: float) -> Shape:
    """The footprint in cells of `resolution` (m), padded by half of STEP."""
    if footprint is None or is_round(footprint):
        return Shape(0, np.zeros((6, 1)), 0.0, ROUND_STEP, True)
    polygon = shapely.Polygon(footprint.vertices / resolution).buffer(0.5 * STEP, join_style="mitre", mitre_limit=3.0)
    corners = np.asarray(polygon.exterior.coords)[:-1]
    reach = float(np.hypot(corners[:, 0], corners[:, 1]).max())
    convex = bool(abs(polygon.convex_hull.area - polygon.area) < 1e-9 * polygon.area)
    rows = np.zeros((6, max(len(corners), math.ceil(2.0 * reach) + 4)))
    rows[:2, : len(corners)] = corners.T
    return Shape(len(corners), rows, reach, STEP, convex)
