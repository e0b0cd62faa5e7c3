"""Whether the way ahead is free: the whole footprint, on both costmaps."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from navstack.core import Pose2D, Transform2D, describe_cost
from navstack.core.collision import footprint_cost, overlaps_obstacle
from navstack.core.costs import LETHAL
from navstack.core.overlap import excusing_overlap
from navstack.interfaces import RecoveryContext

STEP_RAD = 0.017
"""Angle between two checks of a turn, as in rotate_recovery."""


@dataclass(frozen=True, slots=True)
class Obstacle:
    """What ends a motion."""

    index: int
    """Index of the first pose at which the footprint is not free."""
    costmap: str
    cost: int | None
    """Cost under the footprint; None: it leaves the local costmap."""

    def __str__(self) -> str:
        if self.cost is None:
            return f"the edge of the {self.costmap}"
        return f"an obstacle of the {self.costmap} (cost {describe_cost(self.cost)})"


def straight(context: RecoveryContext, distance: float) -> NDArray[np.float64]:
    """Return poses (n, 3) in the base frame along a straight motion by `distance` (m), every half cell."""
    step = 0.5 * context.local_costmap.master.geometry.resolution
    count = max(1, math.ceil(abs(distance) / step))
    poses = np.zeros((count + 1, 3))
    poses[:, 0] = np.linspace(0.0, distance, count + 1)
    return poses


def turning(angle: float) -> NDArray[np.float64]:
    """Return poses (n, 3) in the base frame along a turn in place by `angle` (rad), at most once around."""
    angle = min(max(angle, -2.0 * math.pi), 2.0 * math.pi)
    count = max(1, math.ceil(abs(angle) / STEP_RAD))
    poses = np.zeros((count + 1, 3))
    poses[:, 2] = np.linspace(0.0, angle, count + 1)
    return poses


def first_obstacle(
    context: RecoveryContext, local: Pose2D, now: float, ahead: NDArray[np.float64], *, known_only: bool = False
) -> Obstacle | None:
    """Return the first pose at which the footprint is not free; None if all are.

    `ahead` (n, 3) are poses in the base frame, `local` is the robot in the local costmap's frame. On the local costmap lethal
    and unknown cells and its edge count, as for back_up; on the global costmap lethal cells, which the sensors may not see now.
    Where the footprint overlaps lethal cells now, a motion that leads away from them is free, and no other.
    With `known_only` the global costmap alone is checked. Raises FrameError without the robot's pose in the map.
    """
    known, seen = context.global_costmap, context.local_costmap
    in_map = Transform2D(*known.robot_pose(now)).apply_poses(ahead)
    in_local = Transform2D(*local).apply_poses(ahead)
    seen_costs = excusing_overlap(seen.master, seen.footprint, in_local)
    known_costs = excusing_overlap(known.master, known.footprint, in_map)
    for k, (global_pose, local_pose) in enumerate(zip(in_map.tolist(), in_local.tolist())):
        if not known_only:
            cost = footprint_cost(seen_costs, seen.footprint, Pose2D(*local_pose))
            if cost is None or cost >= LETHAL:
                return Obstacle(k, seen.name, cost)
        if overlaps_obstacle(known_costs, known.footprint, Pose2D(*global_pose)):
            return Obstacle(k, known.name, LETHAL)
    return None
