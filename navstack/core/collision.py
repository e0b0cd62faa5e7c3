"""Collision check: the cost under the robot's footprint at a pose or along a turn in place.

The edges are those of base_local_planner's CostmapModel::footprintCost. ROS differs: there, only the edges are checked, and as
lines of cells from corner to corner, which miss cells that the footprint overlaps. Here every overlapped cell counts.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from navstack.core import footprint_kernels as kernels
from navstack.core.costs import LETHAL
from navstack.core.errors import InputError
from navstack.core.footprint import Footprint
from navstack.core.geometry import Pose2D
from navstack.core.grid import Costmap


def footprint_cost(costmap: Costmap, footprint: Footprint, pose: Pose2D, *, interior: bool = True) -> int | None:
    """Return the highest cost under the footprint at `pose` (costmap's frame); None if a part of it is outside the grid.

    254 is an obstacle, 255 an unknown cell. With `interior=False` only the edges count, as in ROS.
    """
    if not pose.is_finite():
        return None
    g = costmap.geometry
    cost = kernels.pose_cost(
        costmap.data,
        float(g.origin_x),
        float(g.origin_y),
        float(g.resolution),
        footprint.vertices,
        float(pose.x),
        float(pose.y),
        float(pose.yaw),
        interior,
    )
    return _known(int(cost))


def overlaps_obstacle(costmap: Costmap, footprint: Footprint, pose: Pose2D) -> bool:
    """Return True if the footprint at `pose` (costmap's frame) overlaps a lethal cell.

    Unknown cells do not count, nor does a footprint that is partly outside the grid.
    """
    if not pose.is_finite():
        return False
    g = costmap.geometry
    return bool(
        kernels.lethal_under(
            costmap.data,
            float(g.origin_x),
            float(g.origin_y),
            float(g.resolution),
            footprint.vertices,
            float(pose.x),
            float(pose.y),
            float(pose.yaw),
        )
    )


def turn_cost(
    costmap: Costmap,
    footprint: Footprint,
    pose: Pose2D,
    arc: float,
    *,
    step: float = 0.017,
    limit: int = LETHAL,
    interior: bool = True,
) -> tuple[int | None, float]:
    """Check a turn in place from `pose` (costmap's frame) by `arc` (rad, of either sign), every `step` (rad).

    Returns the highest cost under the footprint and `arc`; or the first cost of at least `limit` (None: outside the grid) and
    the angle turned before it (rad). Raises InputError if the step is not positive or the arc is not finite.
    """
    if not (step > 0.0 and math.isfinite(step)):
        raise InputError(f"the step of a turn must be a positive angle in radians, not {step}", step=step)
    if not (pose.is_finite() and math.isfinite(arc)):
        raise InputError(f"a turn by {arc} rad from {tuple(pose)} is not finite", pose=pose, arc=arc)
    g = costmap.geometry
    cost, turned = kernels.turn_cost(
        costmap.data,
        float(g.origin_x),
        float(g.origin_y),
        float(g.resolution),
        footprint.vertices,
        float(pose.x),
        float(pose.y),
        float(pose.yaw),
        float(arc),
        float(step),
        limit,
        interior,
    )
    return _known(int(cost)), float(turned)


def _known(cost: int) -> int | None:
    return None if cost == kernels.OUTSIDE else cost


TOUCHED_CELLS: Final = 1.5
"""A lethal cell at most this far from the footprint (cells) is a mark of the obstacle that it touches."""


def nearest_lethal(costmap: Costmap, footprint: Footprint, pose: Pose2D) -> tuple[float, tuple[float, float]] | None:
    """Return the distance (m) from the footprint at `pose` to the nearest lethal cell, and the cell's center; None without one.

    Pose and center are in the costmap's frame.
    """
    g = costmap.geometry
    iy, ix = np.nonzero(costmap.data == LETHAL)
    if not len(ix):
        return None
    # the footprint is in the base frame
    x, y = g.origin_x + (ix + 0.5) * g.resolution, g.origin_y + (iy + 0.5) * g.resolution
    c, s = math.cos(pose.yaw), math.sin(pose.yaw)
    ahead, left = x - pose.x, y - pose.y
    cells = shapely.points(np.column_stack((c * ahead + s * left, c * left - s * ahead)))
    distances: NDArray[np.float64] = np.asarray(shapely.distance(footprint.polygon, cells))
    nearest = int(distances.argmin())
    return float(distances[nearest]), (float(x[nearest]), float(y[nearest]))


def touches_lethal(costmap: Costmap, footprint: Footprint, pose: Pose2D) -> bool:
    """Return True if the footprint at `pose` (costmap's frame) touches an obstacle that the costmap has."""
    found = nearest_lethal(costmap, footprint, pose)
    return found is not None and found[0] <= TOUCHED_CELLS * costmap.geometry.resolution
