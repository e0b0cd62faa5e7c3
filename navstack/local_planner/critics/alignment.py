"""Keeps the robot's nose on the plan (alignment_costs_ of DWAPlanner)."""

from __future__ import annotations

from typing import ClassVar

from navstack.local_planner.critics.path import PathParams
from navstack.local_planner.map_grid import NOSE_CODES, MapGridCritic, distance_weight, shared_path_grid
from navstack.plugins import CRITICS, DistanceGrid, ParamModel, ScoringContext, param


class AlignmentParams(PathParams):
    """Weight, as of the critic path, position of the nose, and the distance from the goal at which alignment is off."""

    forward_point_distance: float = param(0.325, "distance of the nose from the robot's center", unit="m")
    cheat_factor: float = param(
        1.0, "factor on the squared forward_point_distance within which alignment is off near the goal", ge=0.0
    )


@CRITICS.register("alignment")
class AlignmentCritic(MapGridCritic[AlignmentParams]):
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
        x, y, _ = context.state.pose
        end_x, end_y, _ = context.plan[-1].tolist()
        dx, dy = end_x - x, end_y - y
        if dx * dx + dy * dy > p.forward_point_distance * p.forward_point_distance * p.cheat_factor:
            return distance_weight(p.path_distance_bias, context.costmap.geometry.resolution, p.ros_distro)
        return 0.0

    def build(self, context: ScoringContext) -> DistanceGrid:
        """Distances to the plan, shared with the path critic."""
        return shared_path_grid(context, self._builder)
