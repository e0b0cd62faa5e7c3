"""rotate_recovery: a full turn in place, to see the surroundings.

Source: rotate_recovery/src/rotate_recovery.cpp.
"""

from __future__ import annotations

import math
from typing import Final

from navstack.core import Pose2D, RobotState, Twist2D
from navstack.core.collision import turn_cost
from navstack.core.errors import CollisionAheadError
from navstack.core.parameters import ParamModel, param
from navstack.interfaces import RecoveryBehavior, RecoveryContext, RecoveryStatus, RecoveryStep
from navstack.plugins import RECOVERY_BEHAVIORS
from navstack.recovery.motion import TurnProgress, blocks, describe_obstacle, require_turning

FULL_TURN: Final = 2.0 * math.pi
TURN_TOLERANCE: Final = 0.1
"""rad; limits the robot's yaw_goal_tolerance, so that a wide one does not shorten the turn."""


class RotateRecoveryParams(ParamModel):
    """Namespace: the instance's name. The local planner's limits apply to the turn (parity 19)."""

    sim_granularity: float = param(0.017, "angle between two collision checks", unit="rad", gt=0.0)
    frequency: float = param(20.0, "rate of the commands", unit="Hz", gt=0.0)
    max_rotational_vel: float = param(
        1.0,
        "maximum rotational speed, limited by the local planner's; a slow turn shows the sensors more (name and value of "
        "Nav2's spin)",
        unit="rad/s",
        gt=0.0,
        ros_differs="ROS has no such parameter and uses TrajectoryPlannerROS/max_vel_theta, by default 1.0",
    )


@RECOVERY_BEHAVIORS.register("rotate_recovery", aliases=("rotate_recovery/RotateRecovery",))
class RotateRecovery(RecoveryBehavior):
    """Turns by 2 pi, counter-clockwise, at `sqrt(2 * acceleration * remaining angle)` within the planner's limits.

    Before each command the whole footprint is checked along the rest of the turn on the local costmap.

    ROS differs: there, limits and tolerance are those of TrajectoryPlannerROS even under DWA, only the footprint's edges are
    checked, and the robot continues to turn at the end.
    """

    Params = RotateRecoveryParams
    turns_in_place = True
    params: RotateRecoveryParams

    def __init__(self, name: str, params: RotateRecoveryParams) -> None:
        super().__init__(name, params)
        self._context: RecoveryContext | None = None
        self._progress = TurnProgress()

    @property
    def frequency(self) -> float:
        """Rate of the commands (Hz)."""
        return self.params.frequency

    def start(self, context: RecoveryContext, now: float) -> None:
        """Start from the heading of the first step. Raises CannotTurnError for a base with a turning radius."""
        del now
        require_turning(context, self.name)
        self._context = context
        self._progress = TurnProgress()

    def step(self, state: RobotState, now: float) -> RecoveryStep:
        """Return the next command. Raises CollisionAheadError if the footprint collides in the rest of the turn."""
        del now
        context = self._context
        assert context is not None
        first = self._progress.update(state.pose.yaw)
        turned = self._progress.turned
        data = {"turned_rad": turned}
        limits = context.local_planner.limits
        left = FULL_TURN - turned
        if left <= min(TURN_TOLERANCE, limits.yaw_goal_tolerance):
            return RecoveryStep(RecoveryStatus.DONE, text="Rotate recovery behavior finished.", data=data)
        self._check_turn(context, state.pose, left)
        p = self.params
        # a robot cannot follow more than half a turn per step
        fastest = min(limits.max_vel_theta, p.max_rotational_vel, 0.5 * math.pi * p.frequency)
        slowest = min(abs(limits.min_vel_theta), fastest)
        speed = min(max(math.sqrt(2.0 * limits.acc_lim_theta * left), slowest), fastest)
        text = "Rotate recovery behavior started." if first else ""
        return RecoveryStep(RecoveryStatus.RUNNING, Twist2D(0.0, 0.0, speed), text, data)

    def _check_turn(self, context: RecoveryContext, pose: Pose2D, angle: float) -> None:
        """Raise CollisionAheadError if the footprint collides while it turns by `angle` (rad)."""
        costmap = context.local_costmap
        cost, at = turn_cost(costmap.master, costmap.footprint, pose, angle, step=self.params.sim_granularity)
        if blocks(cost):
            raise CollisionAheadError(
                "Rotate recovery can't rotate in place because there is a potential collision: the footprint hits "
                f"{describe_obstacle(cost)} after {math.degrees(at):.0f} of the remaining {math.degrees(angle):.0f} degrees",
                cost=cost,
                turned_rad=self._progress.turned,
                left_rad=angle,
                collision_after_rad=at,
            )
