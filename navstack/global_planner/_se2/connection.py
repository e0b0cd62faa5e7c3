"""Early proof that no path exists: the footprint fits in no cell, at no heading, on any way between start and goal."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from navstack.global_planner._se2 import _connection_kernels as kernels
from navstack.global_planner._se2.footprint import Shape
from navstack.global_planner._se2.memory import untouched_zeros
from navstack.global_planner._se2.outcome import Pose

TURN: Final = 0.25
"""Cells: how far a point of the footprint moves in half the angle between two headings."""
WITHIN_CELL: Final = math.sqrt(0.5)
"""Cells: how far the middle of a cell is from its other points."""
BUCKETS: Final = 4096
"""Of the queue of cells."""
MOST: Final = 1_000_000
"""Checks of the footprint, after which nothing is proved."""


def may_connect(
    costs: NDArray[np.uint8],
    bits: NDArray[np.uint64],
    shape: Shape,
    heuristic: tuple[NDArray[np.void], NDArray[np.void]],
    settings: NDArray[np.void],
    start: Pose,
) -> bool:
    """Return False if it is certain that no path leads from `start` to the goal of the heuristic or near it (tolerance)."""
    p, (ny, nx) = settings[0], costs.shape
    rows = smaller(shape)
    headings = max(8, math.ceil(math.pi * shape.reach / TURN))
    seen, after = (untouched_zeros(nx * ny, np.dtype(kind)) for kind in (np.int16, np.int32))
    lists = np.full(BUCKETS, -1, np.int32), after
    near = float(p["tolerance"]) + 2.0 * WITHIN_CELL
    ends = int(start[1]) * nx + int(start[0]), float(p["goal_x"]), float(p["goal_y"]), near
    return bool(kernels.may_connect(costs, bits, rows, *heuristic, p, seen, lists, ends, headings, MOST))


def smaller(shape: Shape) -> NDArray[np.float64]:
    """Return rows as of `Shape`: of what remains of the footprint where its points move within a cell and half a heading.

    Level 1: within parts of these. Level 2: of what it covers at all headings, within a cell. Where nothing remains, that is a
    triangle without area, which is blocked nowhere.
    """
    rows = np.zeros((12, 2 * shape.rows.shape[1] + 8))
    corners = int(shape.rows[0, 0])
    whole = shapely.Polygon(shape.rows[6:8, :corners].T if corners > 0 else None)
    padding, centre = float(shape.rows[1, 0]), shapely.Point(0.0, 0.0)
    inside = whole.exterior.distance(centre) if whole.contains(centre) else 0.0
    turns = 0.25 * math.pi * np.arange(8)
    octagon = max(0.0, inside - WITHIN_CELL - padding) * np.column_stack((np.cos(turns), np.sin(turns)))
    for level, parts in enumerate((1, kernels.PARTS, 0)):
        points = octagon
        if parts > 0:
            by = (WITHIN_CELL + TURN) / parts + padding
            left = shapely.get_parts(whole.buffer(-by, join_style="mitre", mitre_limit=100.0))
            points = np.asarray(max(left, key=shapely.area).exterior.coords)[:-1] if len(left) else np.zeros((0, 2))
        rows[0, level] = 3
        if 3 <= len(points) <= rows.shape[1]:
            rows[0, level], rows[6 + 2 * level : 8 + 2 * level, : len(points)] = len(points), points.T
    return rows
