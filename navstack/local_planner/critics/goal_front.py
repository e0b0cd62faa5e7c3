"""Points the robot's nose at the goal (DWAPlanner's goal_front_costs_)."""

from __future__ import annotations

import math
from typing import ClassVar

from navstack.core import Pose2D
from navstack.core.parameters import ParamModel, param
from navstack.interfaces import ScoringContext
from navstack.local_planner.critics._map_grid_critic import NOSE_CODES, MapGridCritic
from navstack.local_planner.critics._weights import RosDistro, distance_scale
from navstack.local_planner.map_grid import MapGrid
from navstack.plugins import CRITICS


class GoalFrontParams(ParamModel):
    """Weight, and where the nose is."""

    FROM_NAVSTACK = frozenset({"ros_distro"})

    goal_distance_bias: float = param(0.8, "weight of the distance to the local goal, per metre", ge=0.0)
    forward_point_distance: float = param(0.325, "distance of the nose point from the robot's centre", unit="m")
    ros_distro: RosDistro = param("noetic", "scoring scale of noetic, or of the releases before 2018")


@CRITICS.register("goal_front")
class GoalFrontCritic(MapGridCritic):
    """Distance from the nose at the trajectory's last point to the end of a plan that is pushed on past the goal.

    The plan's last pose is moved by `forward_point_distance` away from the robot.
    """

    Params: ClassVar[type[ParamModel]] = GoalFrontParams
    CODES: ClassVar[dict[int, str]] = NOSE_CODES

    def __init__(self, name: str, params: GoalFrontParams) -> None:
        super().__init__(name, params, ahead=params.forward_point_distance)

    def weight(self, context: ScoringContext) -> float:
        """`goal_distance_bias` times the resolution; half of that before 2018."""
        p = self.params
        return distance_scale(p.goal_distance_bias, context.costmap.geometry.resolution, p.ros_distro)

    def build(self, context: ScoringContext) -> MapGrid:
        """Distances to the pushed goal."""
        ahead = self.params.forward_point_distance
        plan = context.plan.copy()
        pose = context.state.pose
        bearing = math.atan2(plan[-1, 1] - pose.y, plan[-1, 0] - pose.x)
        plan[-1, 0] += ahead * math.cos(bearing)
        plan[-1, 1] += ahead * math.sin(bearing)
        nose = Pose2D(pose.x + ahead * math.cos(pose.yaw), pose.y + ahead * math.sin(pose.yaw))
        return self._buffer.build(context.costmap, plan, nose, last_only=True)
