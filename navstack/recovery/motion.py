"""What the recovery behaviors that move the robot share: parameters, progress of a turn, and collision messages."""

from __future__ import annotations

import math

from navstack.core import Pose2D, angle_between, describe_cost
from navstack.core.collision import overlaps_obstacle
from navstack.core.costs import LETHAL
from navstack.core.parameters import ParamModel, param
from navstack.interfaces import RecoveryContext
from navstack.recovery.errors import CannotTurnError


class MotionParams(ParamModel):
    """Parameters of Nav2's motions; names and defaults as in Nav2."""

    time_allowance: float = param(10.0, "time limit of the motion", unit="s", gt=0.0)
    simulate_ahead_time: float = param(2.0, "time ahead to check for collisions", unit="s", ge=0.0)
    cycle_frequency: float = param(10.0, "rate of the commands", unit="Hz", gt=0.0)
    disable_collision_checks: bool = param(False, "move without collision checks")


class TurnProgress:
    """The angle turned since the first step, counted beyond a full turn."""

    def __init__(self) -> None:
        self.turned = 0.0
        """rad, counter-clockwise."""
        self._yaw: float | None = None

    def update(self, yaw: float) -> bool:
        """Add the turn to the heading `yaw` (rad); return True in the first step."""
        first = self._yaw is None
        if self._yaw is not None:
            self.turned += angle_between(self._yaw, yaw)
        self._yaw = yaw
        return first


def require_turning(context: RecoveryContext, name: str) -> None:
    """Raise CannotTurnError if the base has a turning radius: it would stand still."""
    radius = context.local_planner.limits.min_turning_radius
    if radius > 0.0:
        raise CannotTurnError(
            f"{name} turns in place, which a base with a turning radius of {radius:g} m cannot; leave it out of "
            "recovery_behaviors, or set clearing_rotation_allowed to false",
            min_turning_radius_m=radius,
        )


def blocks(cost: int | None) -> bool:
    """Return True for a footprint cost that is a collision: lethal, or None for the edge of the costmap."""
    return cost is None or cost >= LETHAL


def describe_obstacle(cost: int | None) -> str:
    """Return the obstacle behind such a cost, for messages."""
    return "the edge of the costmap" if cost is None else f"cost {describe_cost(cost)}"


def known_obstacle_after(
    context: RecoveryContext, now: float, distance: float, arc: float, *, step: float
) -> float | None:
    """Return how far (m, or rad for a turn) the footprint can move before it overlaps an obstacle of the global costmap.

    The motion is straight by `distance` (m) or a turn by `arc` (rad), backwards or clockwise if negative, checked every `step`.
    None if it is free. Obstacles that the sensors do not see now, such as walls of the map behind the robot, count here; unknown
    cells and the space beyond the map do not. Raises FrameError without the robot's pose in the global costmap's frame.
    """
    costmap = context.global_costmap
    pose = costmap.robot_pose(now)
    size = max(abs(distance), abs(arc))
    for k in range(math.ceil(size / step - 1e-9) + 1):
        share = min(k * step / size, 1.0) if size > 0.0 else 0.0
        along = share * distance
        x, y = pose.x + along * math.cos(pose.yaw), pose.y + along * math.sin(pose.yaw)
        if overlaps_obstacle(costmap.master, costmap.footprint, Pose2D(x, y, pose.yaw + share * arc)):
            return share * size
    return None
