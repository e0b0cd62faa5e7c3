"""What a planner makes of a start that its rule does not let a path enter: refuse, clear, or begin elsewhere."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import FREE, Costmap, Footprint, Pose2D
from navstack.global_planner import ends
from navstack.global_planner.cost_rule import CostRule

StartPolicy = Literal["clear_cell", "clear_footprint", "nearest_free", "refuse"]


class Departure(NamedTuple):
    """Where the search begins, and on what costs."""

    costmap: Costmap
    """The costs to plan on: those given, or a copy with the cells under the footprint free."""
    pose: Pose2D
    """Where the searched part of the path begins: the start, or the centre of the nearest free cell."""
    cell: ends.Cell
    lead: NDArray[np.float64]
    """(n, 2) points (m) from the start to `pose`, without the latter, at most a cell apart; empty when both are the same."""
    note: str | None
    """What was done, in a sentence; None when the start is free."""


_NOWHERE = np.empty((0, 2))


def depart(
    costmap: Costmap,
    rule: CostRule,
    start: Pose2D,
    cell: ends.Cell,
    footprint: Footprint | None,
    policy: StartPolicy,
    *,
    ring: bool,
) -> Departure:
    """Applies the start policy. `ring`: the outermost cells are blocked.

    Raises StartOccupiedError when the policy is `refuse`, or when there is no free cell to begin in.
    """
    if not ends.is_blocked(costmap, rule, cell, ring=ring):
        return Departure(costmap, start, cell, _NOWHERE, None)
    if policy == "refuse":
        raise ends.start_occupied(costmap, rule, start, cell, ring=ring, because="start_policy is refuse")
    if policy == "nearest_free":
        free = ends.nearest_free(costmap, rule, cell, ring=ring)
        if free is None:
            raise ends.start_occupied(costmap, rule, start, cell, ring=ring)
        (ix, iy), distance = free
        x, y = costmap.geometry.cell_to_world(ix, iy)
        note = (
            "the start lies in a blocked cell; the plan begins at the nearest free one, "
            f"{distance:.2f} m away at ({x:.2f}, {y:.2f})"
        )
        pose = Pose2D(x, y, start.yaw)
        return Departure(costmap, pose, (ix, iy), _lead(costmap, start, pose), note)
    if policy == "clear_cell" or footprint is None:
        return Departure(costmap, start, cell, _NOWHERE, "the start lies in a blocked cell, which was taken for free")
    cleared = costmap.copy()
    cleared.data[_under(costmap, footprint, start)] = FREE
    note = "the start lies in a blocked cell; the cells under the footprint were taken for free"
    return Departure(cleared, start, cell, _NOWHERE, note)


def _lead(costmap: Costmap, start: Pose2D, to: Pose2D) -> NDArray[np.float64]:
    n = max(1, math.ceil(start.distance_to(to) / costmap.geometry.resolution))
    a, b = np.array(start[:2]), np.array(to[:2])
    return a + (b - a) * (np.arange(n) / n)[:, None]


def _under(costmap: Costmap, footprint: Footprint, pose: Pose2D) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Indices of the cells whose centre lies under the footprint, and of the one that holds the pose."""
    import shapely

    g = costmap.geometry
    outline = footprint.at(pose)
    x0, y0 = g.world_to_cell_unbounded(*outline.min(axis=0))
    x1, y1 = g.world_to_cell_unbounded(*outline.max(axis=0))
    xs, ys = np.meshgrid(np.arange(max(x0, 0), min(x1 + 1, g.nx)), np.arange(max(y0, 0), min(y1 + 1, g.ny)))
    inside = shapely.contains_xy(
        shapely.Polygon(outline), g.origin_x + (xs + 0.5) * g.resolution, g.origin_y + (ys + 0.5) * g.resolution
    )
    own = g.world_to_cell_unbounded(pose.x, pose.y)
    inside |= (xs == own[0]) & (ys == own[1])
    return ys[inside], xs[inside]
