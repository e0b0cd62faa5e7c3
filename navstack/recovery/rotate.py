"""rotate_recovery: a full turn in place, to look around.

Source: rotate_recovery/src/rotate_recovery.cpp.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

from navstack.core import RobotState, Twist2D, angle_between, describe_cost
from navstack.core.collision import turn_cost
from navstack.core.costs import LETHAL
from navstack.core.errors import CollisionAheadError
from navstack.core.parameters import ParamModel, param
from navstack.interfaces import RecoveryBehavior, RecoveryContext, RecoveryStatus, RecoveryStep
from navstack.plugins import RECOVERY_BEHAVIORS

FULL_TURN = 2.0 * math.pi
TURN_TOLERANCE = 0.1
"""rad. A robot's yaw_goal_tolerance may be wide; the turn is to be a whole one all the same."""


class RotateRecoveryParams(ParamModel):
    """Namespace: the instance's name. The limits of the turn are those of the local planner in use (parity 19)."""

    NO_EFFECT: ClassVar[Mapping[str, str]] = {}

    sim_granularity: float = param(0.017, "angle between two checks for collision", unit="rad", gt=0.0)
    frequency: float = param(20.0, "commands per second", unit="Hz", gt=0.0)
    max_rotational_vel: float = param(
        1.0,
        "highest turning speed of the behaviour, below the local planner's own limit: a turn that is to show the sensors "
        "everything has no hurry (name and value as Nav2's spin)",
        unit="rad/s",
        gt=0.0,
        ros_differs="ROS has no such parameter and takes TrajectoryPlannerROS/max_vel_theta, 1.0 by default",
    )


@RECOVERY_BEHAVIORS.register("rotate_recovery", aliases=("rotate_recovery/RotateRecovery",))
class RotateRecovery(RecoveryBehavior):
    """Turns by 2 pi, counter-clockwise, at `sqrt(2 * acceleration * angle left)` within the planner's limits.

    Before each command the whole outline is checked over the rest of the turn on the local costmap.

    ROS differs: there, limits and tolerance come from TrajectoryPlannerROS even under DWA, only the outline's edges are
    checked, and the robot is left turning at the end.
    """

    Params = RotateRecoveryParams
    params: RotateRecoveryParams

    def __init__(self, name: str, params: RotateRecoveryParams) -> None:
        super().__init__(name, params)
        self._context: RecoveryContext | None = None
        self._turned = 0.0
        self._yaw: float | None = None

    @property
    def frequency(self) -> float:
        """Commands per second."""
        return self.params.frequency

    def start(self, context: RecoveryContext, now: float) -> None:
        """Turns from the heading at the first step."""
        del now
        self._context = context
        self._turned = 0.0
        self._yaw = None

    def step(self, state: RobotState, now: float) -> RecoveryStep:
        """The next command; raises CollisionAheadError when the rest of the turn would hit something."""
        del now
        context = self._context
        assert context is not None
        first = self._yaw is None
        if self._yaw is not None:
            self._turned += angle_between(self._yaw, state.pose.yaw)
        self._yaw = state.pose.yaw
        limits = context.local_planner.limits
        left = FULL_TURN - self._turned
        if left <= min(TURN_TOLERANCE, limits.yaw_goal_tolerance):
            return RecoveryStep(RecoveryStatus.DONE, text="Rotate recovery behavior finished.", data=self._data())
        costmap = context.local_costmap
        cost, at = turn_cost(costmap.master, costmap.footprint, state.pose, left, step=self.params.sim_granularity)
        if cost is None or cost >= LETHAL:
            what = "the edge of the costmap" if cost is None else f"cost {describe_cost(cost)}"
            raise CollisionAheadError(
                "Rotate recovery can't rotate in place because there is a potential collision: after "
                f"{math.degrees(at):.0f} of {math.degrees(left):.0f} degrees left the outline meets {what}",
                cost=cost,
                turned_rad=self._turned,
                left_rad=left,
                collision_after_rad=at,
            )
        # faster than half a turn per step could not be followed
        p = self.params
        fastest = min(limits.max_vel_theta, p.max_rotational_vel, 0.5 * math.pi * p.frequency)
        slowest = min(abs(limits.min_vel_theta), fastest)
        speed = min(max(math.sqrt(2.0 * limits.acc_lim_theta * left), slowest), fastest)
        text = "Rotate recovery behavior started." if first else ""
        return RecoveryStep(RecoveryStatus.RUNNING, Twist2D(0.0, 0.0, speed), text, self._data())

    def _data(self) -> dict[str, float]:
        return {"turned_rad": self._turned}
