"""Start and goal of a plan: their cells, the start policy, and the goals within the tolerance."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import (
    FREE,
    Costmap,
    Footprint,
    GoalOutsideMapError,
    InputError,
    Pose2D,
    StartOutsideMapError,
    normalize_angle,
)
from navstack.global_planner._search import planning_errors as errors
from navstack.global_planner._search.cells import Cell, SearchSpace
from navstack.plugins import CheckContext, Issue

StartPolicy = Literal["clear_cell", "clear_footprint", "nearest_free", "refuse"]

_NO_LEAD = np.empty((0, 2))


class SearchStart(NamedTuple):
    """Where the search begins, and the space it searches."""

    space: SearchSpace
    """The given one, or a copy in which the cells under the footprint are free."""
    pose: Pose2D
    """Start of the searched part of the path: the start pose, or the center of the nearest free cell."""
    cell: Cell
    lead: NDArray[np.float64]
    """(n, 2) points (m) from the start to `pose`, excluding `pose`, at most a cell apart; empty when both are the same."""
    note: str | None
    """How the start was adjusted; None when it is free."""


def with_yaw_in_range(pose: Pose2D) -> Pose2D:
    """The pose with its yaw in (-pi, pi]; unchanged if the yaw is already in range or is not finite."""
    if -math.pi < pose.yaw <= math.pi or not math.isfinite(pose.yaw):
        return pose
    return pose._replace(yaw=normalize_angle(pose.yaw))


def require_finite(start: Pose2D, goal: Pose2D) -> None:
    """Raise InputError for a pose that is not finite."""
    for name, pose in (("start", start), ("goal", goal)):
        if not pose.is_finite():
            raise InputError(
                f"the {name} ({pose.x}, {pose.y}, {pose.yaw}) is not finite; specify x, y (m) and yaw (rad)", pose=pose
            )


def cells_of(costmap: Costmap, start: Pose2D, goal: Pose2D) -> tuple[Cell, Cell]:
    """The cells that contain start and goal; raises InputError, StartOutsideMapError or GoalOutsideMapError."""
    require_finite(start, goal)
    g = costmap.geometry
    left, right, bottom, top = g.extent
    found: list[Cell] = []
    for name, pose, error in (("start", start, StartOutsideMapError), ("goal", goal, GoalOutsideMapError)):
        cell = g.world_to_cell(pose.x, pose.y)
        if cell is None:
            raise error(
                f"the {name} ({pose.x:.3f}, {pose.y:.3f}) is outside the costmap, which covers x {left:.3f} .. {right:.3f}, "
                f"y {bottom:.3f} .. {top:.3f} m in frame {costmap.frame}",
                x=pose.x,
                y=pose.y,
                extent=[left, right, bottom, top],
            )
        found.append(cell)
    return found[0], found[1]


def apply_start_policy(
    space: SearchSpace, start: Pose2D, cell: Cell, footprint: Footprint | None, policy: StartPolicy
) -> SearchStart:
    """Where to begin the search for a path from `start`, which is in `cell`.

    Raises StartOccupiedError when the start is blocked and the policy is `refuse`, or there is no free cell to begin in.
    """
    if not space.is_blocked(cell):
        return SearchStart(space, start, cell, _NO_LEAD, None)
    if policy == "refuse":
        raise errors.start_occupied(space, start, cell, because="start_policy is refuse")
    if policy == "nearest_free":
        return _from_nearest_free(space, start, cell)
    if policy == "clear_cell" or footprint is None:
        return SearchStart(space, start, cell, _NO_LEAD, "the start is in a blocked cell, which was treated as free")
    cleared = space.costmap.copy()
    cleared.data[_cells_under(cleared, footprint, start)] = FREE
    note = "the start is in a blocked cell; the cells under the footprint were treated as free"
    return SearchStart(space._replace(costmap=cleared), start, cell, _NO_LEAD, note)


def _from_nearest_free(space: SearchSpace, start: Pose2D, cell: Cell) -> SearchStart:
    free = space.nearest_free(cell)
    if free is None:
        raise errors.start_occupied(space, start, cell)
    nearest, distance = free
    x, y = space.costmap.geometry.cell_to_world(*nearest)
    note = (
        f"the start is in a blocked cell; the path was searched from the nearest free cell at ({x:.2f}, {y:.2f}), "
        f"{distance:.2f} m away"
    )
    pose = Pose2D(x, y, start.yaw)
    n = max(1, math.ceil(start.distance_to(pose) / space.costmap.geometry.resolution))
    a, b = np.array(start[:2]), np.array(pose[:2])
    return SearchStart(space, pose, nearest, a + (b - a) * (np.arange(n) / n)[:, None], note)


def _cells_under(costmap: Costmap, footprint: Footprint, pose: Pose2D) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Indices (iy, ix) of the cells whose center is under the footprint, and of the cell that contains the pose."""
    import shapely

    g = costmap.geometry
    polygon = footprint.at(pose)
    x0, y0 = g.world_to_cell_unbounded(*polygon.min(axis=0))
    x1, y1 = g.world_to_cell_unbounded(*polygon.max(axis=0))
    xs, ys = np.meshgrid(np.arange(max(x0, 0), min(x1 + 1, g.nx)), np.arange(max(y0, 0), min(y1 + 1, g.ny)))
    inside = shapely.contains_xy(
        shapely.Polygon(polygon), g.origin_x + (xs + 0.5) * g.resolution, g.origin_y + (ys + 0.5) * g.resolution
    )
    own = g.world_to_cell_unbounded(pose.x, pose.y)
    inside |= (xs == own[0]) & (ys == own[1])
    return ys[inside], xs[inside]


def goal_candidates(
    costmap: Costmap, goal: Pose2D, tolerance: float, cell_of: Callable[[float, float], Cell | None] | None = None
) -> list[tuple[Pose2D, Cell]]:
    """Acceptable goals, nearest first: the goal, or with a tolerance (m) a lattice in the square around it.

    The lattice begins at goal - tolerance and has the resolution of the costmap (NavfnROS::makePlan). `cell_of` returns the cell
    of a point (m), None outside the map; by default the cell that contains it.
    """
    g = costmap.geometry
    cell_of = cell_of or g.world_to_cell
    own = cell_of(goal.x, goal.y)
    if tolerance <= 0.0:
        return [] if own is None else [(goal, own)]
    found: list[tuple[float, Pose2D, Cell]] = []
    y = goal.y - tolerance
    while y <= goal.y + tolerance:
        x = goal.x - tolerance
        while x <= goal.x + tolerance:
            cell = cell_of(x, y)
            if cell is not None:
                found.append(((x - goal.x) ** 2 + (y - goal.y) ** 2, Pose2D(x, y, goal.yaw), cell))
            x += g.resolution
        y += g.resolution
    found.sort(key=lambda c: c[0])  # stable: ties go to the first in row order
    if own is not None:  # the exact goal; rounding may have moved its lattice point
        found.insert(0, (0.0, goal, own))
    return [(pose, cell) for _, pose, cell in found]


# ----------------------------------------------------------------------------------------------------------------------
# Checks that global planners share; their parameter models call them in `check`.


def unknown_not_tracked(context: CheckContext, allow_unknown: bool) -> Iterator[Issue]:
    """`allow_unknown: false` keeps plans out of unknown space only if a layer tracks it."""
    costmap = context.global_costmap
    if allow_unknown or costmap.track_unknown_space:
        return
    if any(layer.traits.tracks_unknown_space for layer in costmap.layers):
        return
    message = (
        "allow_unknown = false has no effect because no layer of the global costmap tracks unknown space; set "
        "track_unknown_space: true in global_costmap"
    )
    yield Issue("warning", "unknown-not-tracked", ("allow_unknown",), message)
