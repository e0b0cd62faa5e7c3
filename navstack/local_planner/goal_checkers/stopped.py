"""nav2_controller::StoppedGoalChecker: position, heading, and standing still."""

from __future__ import annotations

from typing import ClassVar

from navstack.core import Twist2D
from navstack.core.parameters import ParamModel, param
from navstack.local_planner.goal_checkers.simple import SimpleGoalChecker, SimpleGoalCheckerParams
from navstack.plugins import GOAL_CHECKERS


class StoppedGoalCheckerParams(SimpleGoalCheckerParams):
    """Tolerances of position, heading and speed."""

    plugin: str = param("nav2_controller::StoppedGoalChecker", "type of the goal checker")
    rot_stopped_velocity: float = param(
        0.25, "turning speed up to which the robot counts as stopped", unit="rad/s", ge=0.0
    )
    trans_stopped_velocity: float = param(0.25, "speed up to which the robot counts as stopped", unit="m/s", ge=0.0)


@GOAL_CHECKERS.register("stopped", aliases=("nav2_controller/StoppedGoalChecker",))
class StoppedGoalChecker(SimpleGoalChecker):
    """As the simple one, with the robot stopped."""

    Params: ClassVar[type[ParamModel]] = StoppedGoalCheckerParams

    def stopped(self, velocity: Twist2D) -> bool:
        """At most both stopped speeds."""
        return abs(velocity.wz) <= self.params.rot_stopped_velocity and velocity.speed <= (
            self.params.trans_stopped_velocity
        )
