"""nav2_controller::PositionGoalChecker: the position alone, also the base of the checkers that ask for a heading."""

from __future__ import annotations

import math
from typing import Any, ClassVar

from navstack.core.parameters import ParamModel, param
from navstack.interfaces import Approach, GoalChecker, PluginSection
from navstack.plugins import GOAL_CHECKERS


class PositionGoalCheckerParams(PluginSection):
    """Tolerance of the position, and its latch."""

    plugin: str = param("nav2_controller::PositionGoalChecker", "type of the goal checker")
    xy_goal_tolerance: float = param(0.25, "distance at which the goal's position is reached", unit="m", ge=0.0)
    xy_goal_tolerance_buffer: float = param(
        0.0, "a latched position is released beyond xy_goal_tolerance plus this distance; 0 = never", unit="m", ge=0.0
    )
    path_length_tolerance: float = param(
        1.0,
        "the goal is not reached while more of the path is left: a path that loops past its goal is followed to its end",
        unit="m",
        ge=0.0,
        ros_differs="the whole path that is left counts; in Nav2 only that in the local costmap and within prune_distance",
    )
    stateful: bool = param(
        True,
        "once reached, the position counts as reached",
        ros_differs="a new plan to the same goal does not release it",
    )


@GOAL_CHECKERS.register("position", aliases=("nav2_controller/PositionGoalChecker",))
class PositionGoalChecker(GoalChecker):
    """The robot's position, at any heading and speed."""

    Params: ClassVar[type[ParamModel]] = PositionGoalCheckerParams

    def __init__(self, params: PositionGoalCheckerParams) -> None:
        self.params: Any = params
        self._latched = False

    def reset(self) -> None:
        """Release the latch."""
        self._latched = False

    @property
    def xy_tolerance(self) -> float:
        """`xy_goal_tolerance`."""
        return self.params.xy_goal_tolerance

    @property
    def yaw_tolerance(self) -> float:
        """Every heading."""
        return math.pi

    def at_position(self, approach: Approach) -> bool:
        """Within the tolerance or latched, and the path followed to its end."""
        p = self.params
        if approach.remaining_m > p.path_length_tolerance:
            return False
        distance = approach.pose.distance_to(approach.goal)
        if self._latched:
            if p.xy_goal_tolerance_buffer <= 0.0 or distance <= p.xy_goal_tolerance + p.xy_goal_tolerance_buffer:
                return True
            self._latched = False
        reached = distance <= p.xy_goal_tolerance
        self._latched = p.stateful and reached
        return reached

    def at_heading(self, approach: Approach) -> bool:
        """Always."""
        del approach
        return True
