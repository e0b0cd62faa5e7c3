"""Points the robot's nose at the goal (goal_front_costs_ of DWAPlanner)."""

from __future__ import annotations

import math
from typing import ClassVar

from navstack.core import Pose2D
from navstack.core.parameters import ParamModel, param
from navstack.interfaces import ScoringContext
from navstack.local_planner._map_grid_kernels import extend_plan
from navstack.local_planner.critics._map_grid_critic import NOSE_CODES, MapGridCritic
from navstack.local_planner.critics._weights import RosDistro, distance_weight
from navstack.local_planner.map_grid import MapGrid
from navstack.plugins import CRITICS


class GoalFrontParams(ParamModel):
    """Weight, and position of the nose."""

    FROM_NAVSTACK = frozenset({"ros_distro"})

    goal_distance_bias: float = param(0.8, "weight of the distance to the local goal, per metre", ge=0.0)
    forward_point_distance: float = param(0.325, "distance of the nose from the robot's centre", unit="m")
    ros_distro: RosDistro = param("noetic", "scoring scale of noetic, or of the releases before 2018")


@CRITICS.register("goal_front")
class GoalFrontCritic(MapGridCritic):
    """Distance from the nose at the rollout's last point to the end of a plan that is extended beyond the goal.

    The plan's last pose is moved away from the robot by `forward_point_distance`.
    """

    Params: ClassVar[type[ParamModel]] = GoalFrontParams
    CODES: ClassVar[dict[int, str]] = NOSE_CODES

    def __init__(self, name: str, params: GoalFrontParams) -> None:
        super().__init__(name, params, ahead=params.forward_point_distance)

    def weight(self, context: ScoringContext) -> float:
        """`goal_distance_bias` times the resolution; half of that before 2018."""
        p = self.params
        return distance_weight(p.goal_distance_bias, context.costmap.geometry.resolution, p.ros_distro)

    def build(self, context: ScoringContext) -> MapGrid:
        """Distances to the extended goal."""
        ahead = self.params.forward_point_distance
        pose = context.state.pose
        plan = extend_plan(context.plan, float(pose.x), float(pose.y), ahead)
        nose = Pose2D(pose.x + ahead * math.cos(pose.yaw), pose.y + ahead * math.sin(pose.yaw))
        return self._builder.build(context.costmap, plan, nose, last_only=True)
