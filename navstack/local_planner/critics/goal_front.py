"""Points the robot's nose at the goal (goal_front_costs_ of DWAPlanner)."""

from __future__ import annotations

import math
from typing import ClassVar

from navstack.local_planner.critics.goal import GoalParams
from navstack.local_planner.map_grid import NOSE_CODES, MapGrid, MapGridCritic, distance_weight
from navstack.plugins import CRITICS, ParamModel, ScoringContext, param


class GoalFrontParams(GoalParams):
    """Weight, as of the critic goal, and position of the nose."""

    forward_point_distance: float = param(0.325, "distance of the nose from the robot's center", unit="m")


@CRITICS.register("goal_front")
class GoalFrontCritic(MapGridCritic[GoalFrontParams]):
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
        x, y, yaw = context.state.pose
        plan = context.plan.copy()
        end_x, end_y, _ = plan[-1].tolist()
        bearing = math.atan2(end_y - y, end_x - x)
        plan[-1, 0] = end_x + ahead * math.cos(bearing)
        plan[-1, 1] = end_y + ahead * math.sin(bearing)
        nose = x + ahead * math.cos(yaw), y + ahead * math.sin(yaw)
        return self._builder.build(context, plan, nose, last_only=True)
