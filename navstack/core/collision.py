"""May the robot stand there? Its whole outline on a costmap.

The edges are those of base_local_planner's CostmapModel::footprintCost. ROS differs: there, only the edges are looked at,
so that a robot can stand on an obstacle that is smaller than itself.
"""

from __future__ import annotations

import math

from navstack.core._collision_kernels import outline_cost
from navstack.core._collision_kernels import turn_cost as _turn_cost
from navstack.core.costs import LETHAL
from navstack.core.errors import InputError
from navstack.core.footprint import Footprint
from navstack.core.geometry import Pose2D
from navstack.core.grid import Costmap


def footprint_cost(costmap: Costmap, footprint: Footprint, pose: Pose2D, *, interior: bool = True) -> int | None:
    """Highest cost under the outline at `pose` (costmap's frame), None when a part of it lies outside the grid.

    254 is an obstacle, 255 a cell nobody has looked at. With `interior=False` only the edges count, as in ROS.
    """
    if not pose.is_finite():
        return None
    g = costmap.geometry
    cost = outline_cost(
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
    return None if cost < 0 else int(cost)


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
    """The outline turned in place from `pose` (costmap's frame) by `arc` (rad, either way), looked at every `step` (rad).

    Returns the highest cost on the way and `arc`; or the first cost that is at least `limit` (None: outside the grid) and
    how far the turn came before it (rad). Raises InputError for a step that is not positive or an arc not finite.
    """
    if not (step > 0.0 and math.isfinite(step)):
        raise InputError(f"the step of a turn is a positive angle in radians, not {step}", step=step)
    if not (pose.is_finite() and math.isfinite(arc)):
        raise InputError(f"a turn by {arc} rad from {tuple(pose)} is not finite", pose=pose, arc=arc)
    g = costmap.geometry
    cost, turned = _turn_cost(
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
    return (None if cost < 0 else int(cost)), float(turned)
