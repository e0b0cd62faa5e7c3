"""nav2_controller::AxisGoalChecker: separate tolerances along and across the path's last piece."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np

from navstack.core.parameters import ParamModel, param
from navstack.interfaces import Approach, GoalChecker, PluginSection
from navstack.plugins import GOAL_CHECKERS

AT_GOAL_M = 1e-6
"""Nearer than this the robot is at the goal for any direction of the path."""


class AxisGoalCheckerParams(PluginSection):
    """Tolerances along and across the end of the path."""

    plugin: str = param("nav2_controller::AxisGoalChecker", "type of the goal checker")
    along_path_tolerance: float = param(0.25, "distance to the goal along the end of the path", unit="m", ge=0.0)
    cross_track_tolerance: float = param(0.25, "distance to the goal across the end of the path", unit="m", ge=0.0)
    direction_estimation_distance: float = param(
        0.15, "the path's direction is that from its last pose at least so far before the goal", unit="m", ge=0.0
    )
    path_length_tolerance: float = param(
        1.0,
        "the goal is not reached while more of the path is left",
        unit="m",
        ge=0.0,
        ros_differs="the whole path that is left counts",
    )
    is_overshoot_valid: bool = param(False, "any distance beyond the goal is within the tolerance along the path")


@GOAL_CHECKERS.register("axis", aliases=("nav2_controller/AxisGoalChecker",))
class AxisGoalChecker(GoalChecker):
    """Position in the axes of the path's end, at any heading and speed."""

    Params: ClassVar[type[ParamModel]] = AxisGoalCheckerParams

    def __init__(self, params: AxisGoalCheckerParams) -> None:
        self.params = params

    @property
    def xy_tolerance(self) -> float:
        """The smaller of the two tolerances."""
        return min(self.params.along_path_tolerance, self.params.cross_track_tolerance)

    @property
    def yaw_tolerance(self) -> float:
        """Every heading."""
        return math.pi

    def at_position(self, approach: Approach) -> bool:
        """Within both tolerances, and the path followed to its end."""
        p = self.params
        if approach.remaining_m > p.path_length_tolerance:
            return False
        goal, pose = approach.goal, approach.pose
        distance = pose.distance_to(goal)
        if distance < AT_GOAL_M:
            return True
        before = approach.path[:-1, :2]
        far = np.flatnonzero(
            np.hypot(before[:, 0] - goal.x, before[:, 1] - goal.y) >= max(p.direction_estimation_distance, AT_GOAL_M)
        )
        if not len(far):  # the path has no direction
            return distance < self.xy_tolerance
        ex, ey = goal.x - float(before[far[-1], 0]), goal.y - float(before[far[-1], 1])
        length = math.hypot(ex, ey)
        dx, dy = goal.x - pose.x, goal.y - pose.y
        along, cross = (ex * dx + ey * dy) / length, (ex * dy - ey * dx) / length
        within = along < p.along_path_tolerance if p.is_overshoot_valid else abs(along) < p.along_path_tolerance
        return within and abs(cross) < p.cross_track_tolerance

    def at_heading(self, approach: Approach) -> bool:
        """Always."""
        del approach
        return True
