"""Keeps the robot near the plan (MapGridCostFunction over the path grid)."""

from __future__ import annotations

from typing import ClassVar

from navstack.local_planner.map_grid import CENTER_CODES, MapGridCritic, RosDistro, distance_weight, shared_path_grid
from navstack.plugins import CRITICS, DistanceGrid, ParamModel, ScoringContext, param


class PathParams(ParamModel):
    """Weight of the distance to the plan."""

    FROM_NAVSTACK = frozenset({"ros_distro"})

    path_distance_bias: float = param(
        0.6, "weight of the distance to the plan, per meter (32 before 2018: see ros_distro)", ge=0.0
    )
    ros_distro: RosDistro = param("noetic", "scoring scale of noetic, or of the releases before 2018")


@CRITICS.register("path")
class PathCritic(MapGridCritic[PathParams]):
    """Distance (cells, around obstacles) from the rollout's last point to the plan."""

    Params: ClassVar[type[ParamModel]] = PathParams
    CODES: ClassVar[dict[int, str]] = CENTER_CODES

    def weight(self, context: ScoringContext) -> float:
        """`path_distance_bias` times the resolution; half of that before 2018."""
        p = self.params
        return distance_weight(p.path_distance_bias, context.costmap.geometry.resolution, p.ros_distro)

    def build(self, context: ScoringContext) -> DistanceGrid:
        """Distances to the plan, shared with the alignment critic."""
        return shared_path_grid(context, self._builder)
