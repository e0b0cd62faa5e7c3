"""Straight ways into goals beside obstacles, where a curve to the goal itself would swing into them."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import Footprint
from navstack.global_planner._se2.engine import PoseSearch
from navstack.global_planner._se2.footprint import shape_of

MARGIN: Final = 1.5
"""Cells: a goal is tight if an obstacle is this close to the footprint there."""
LENGTHS: Final = (1.0, 2.2)
"""Lengths of the ways that are tried, in circumscribed radii of the robot."""


def with_tails(
    engine: PoseSearch,
    goals: NDArray[np.float64],
    footprint: Footprint | None,
    resolution: float,
    *,
    reverse: bool,
) -> NDArray[np.float64]:
    """Return the goals (n, 4) with the lengths of the straight ways into tight ones that are free, signed; 0 for none."""
    signs = (1.0, -1.0) if reverse else (1.0,)
    rows = np.zeros((len(goals), 4 + len(signs) * len(LENGTHS)))
    rows[:, :4] = goals
    radius = 0.25 if footprint is None else footprint.circumscribed_radius
    for row in rows:
        x, y, yaw = (float(v) for v in row[:3])
        if not _tight(engine, footprint, resolution, x, y, yaw):
            continue
        lengths = [sign * share * radius / resolution for sign in signs for share in LENGTHS]
        for k, length in enumerate(lengths):
            from_x, from_y = x - length * math.cos(yaw), y - length * math.sin(yaw)
            if engine.line_is_free(from_x, from_y, yaw, length):
                row[4 + k] = length
    return rows


def _tight(engine: PoseSearch, footprint: Footprint | None, resolution: float, x: float, y: float, yaw: float) -> bool:
    if engine.shape.corners == 0:
        around = engine.costs[max(0, int(y) - 2) : int(y) + 3, max(0, int(x) - 2) : int(x) + 3]
        return bool((around >= 253).any())
    before = engine.shape
    engine.use(shape_of(footprint, resolution, MARGIN))
    free = engine.pose_is_free(x, y, yaw)
    engine.use(before)
    return not free
