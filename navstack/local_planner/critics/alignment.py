"""Keeps the robot's nose on the plan (alignment_costs_ of DWAPlanner)."""

from __future__ import annotations

from typing import ClassVar

from navstack.core.parameters import ParamModel, param
from navstack.interfaces import DistanceGrid, ScoringContext
from navstack.local_planner.critics._map_grid_critic import NOSE_CODES, MapGridCritic
from navstack.local_planner.critics._weights import RosDistro, distance_weight
from navstack.local_planner.map_grid import shared_path_grid
from navstack.plugins import CRITICS


class AlignmentParams(ParamModel):
    """Weight, position of the nose, and the distance from the goal at which alignment is off."""

    FROM_NAVSTACK = frozenset({"ros_distro"})

    path_distance_bias: float = param(0.6, "weight of the distance to the plan, per metre", ge=0.0)
    forward_point_distance: float = param(0.325, "distance of the nose from the robot's centre", unit="m")
    cheat_factor: float = param(1.0, "factor on the squared distance within which alignment is switched off", ge=0.0)
    ros_distro: RosDistro = param("noetic", "scoring scale of noetic, or of the releases before 2018")


@CRITICS.register("alignment")
class AlignmentCritic(MapGridCritic):
    """Distance from the nose at the rollout's last point to the plan.

    Skipped within `forward_point_distance` of the end of the local plan.
    """

    Params: ClassVar[type[ParamModel]] = AlignmentParams
    CODES: ClassVar[dict[int, str]] = NOSE_CODES

    def __init__(self, name: str, params: AlignmentParams) -> None:
        super().__init__(name, params, ahead=params.forward_point_distance)

    def weight(self, context: ScoringContext) -> float:
        """`path_distance_bias` times the resolution (half of that before 2018), 0 near the goal."""
        p = self.params
        pose = context.state.pose
        dx, dy = context.plan[-1, 0] - pose.x, context.plan[-1, 1] - pose.y
        if dx * dx + dy * dy > p.forward_point_distance * p.forward_point_distance * p.cheat_factor:
            return distance_weight(p.path_distance_bias, context.costmap.geometry.resolution, p.ros_distro)
        return 0.0

    def build(self, context: ScoringContext) -> DistanceGrid:
        """Distances to the plan, shared with the path critic."""
        return shared_path_grid(context, self._builder)
