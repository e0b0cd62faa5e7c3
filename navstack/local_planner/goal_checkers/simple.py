"""nav2_controller::SimpleGoalChecker: position and heading."""

from __future__ import annotations

import math
from typing import ClassVar

from navstack.core import angle_between
from navstack.core.parameters import ParamModel, param
from navstack.interfaces import Approach
from navstack.local_planner.goal_checkers.position import PositionGoalChecker, PositionGoalCheckerParams
from navstack.plugins import GOAL_CHECKERS


class SimpleGoalCheckerParams(PositionGoalCheckerParams):
    """Tolerances of position and heading."""

    plugin: str = param("nav2_controller::SimpleGoalChecker", "type of the goal checker")
    yaw_goal_tolerance: float = param(0.25, "angle at which the goal's heading is reached", unit="rad", ge=0.0)
    symmetric_yaw_tolerance: bool = param(False, "the opposite of the goal's heading counts, too")


@GOAL_CHECKERS.register("simple", aliases=("nav2_controller/SimpleGoalChecker",))
class SimpleGoalChecker(PositionGoalChecker):
    """Position, then heading; the position is latched."""

    Params: ClassVar[type[ParamModel]] = SimpleGoalCheckerParams

    @property
    def yaw_tolerance(self) -> float:
        """`yaw_goal_tolerance`."""
        return self.params.yaw_goal_tolerance

    def at_heading(self, approach: Approach) -> bool:
        """Within the tolerance of the goal's heading."""
        return at_heading(approach, self.params.yaw_goal_tolerance, symmetric=self.params.symmetric_yaw_tolerance)


def at_heading(approach: Approach, tolerance: float, *, symmetric: bool) -> bool:
    """True within `tolerance` (rad) of the goal's heading, with `symmetric` also of its opposite."""
    error = abs(angle_between(approach.pose.yaw, approach.goal.yaw))
    return min(error, math.pi - error) <= tolerance if symmetric else error <= tolerance
