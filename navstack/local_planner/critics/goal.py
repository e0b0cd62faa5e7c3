"""Moves the robot along the plan (MapGridCostFunction over the goal grid)."""

from __future__ import annotations

from typing import ClassVar

from navstack.core.parameters import ParamModel, param
from navstack.interfaces import DistanceGrid, ScoringContext
from navstack.local_planner.critics._map_grid_critic import CENTRE_CODES, MapGridCritic
from navstack.local_planner.critics._weights import RosDistro, distance_weight
from navstack.local_planner.map_grid import MapGrid
from navstack.plugins import CRITICS


class GoalParams(ParamModel):
    """Weight of the distance to the local goal."""

    FROM_NAVSTACK = frozenset({"ros_distro"})

    goal_distance_bias: float = param(0.8, "weight of the distance to the local goal, per metre", ge=0.0)
    ros_distro: RosDistro = param("noetic", "scoring scale of noetic, or of the releases before 2018")


@CRITICS.register("goal")
class GoalCritic(MapGridCritic):
    """Distance (cells, around obstacles) from the rollout's last point to the plan's last cell in the window."""

    Params: ClassVar[type[ParamModel]] = GoalParams
    CODES: ClassVar[dict[int, str]] = CENTRE_CODES

    def __init__(self, name: str, params: GoalParams) -> None:
        super().__init__(name, params)

    def weight(self, context: ScoringContext) -> float:
        """`goal_distance_bias` times the resolution; half of that before 2018."""
        p = self.params
        return distance_weight(p.goal_distance_bias, context.costmap.geometry.resolution, p.ros_distro)

    def build(self, context: ScoringContext) -> MapGrid:
        """Distances to the local goal."""
        # ROS differs: a local goal in an obstacle cell would leave every other cell unreachable, every sample rejected
        # (parity 27); it is replaced by the last free cell of the plan before it
        return self._builder.build(context.costmap, context.plan, context.state.pose, last_only=True, step_back=True)

    def set_grid(self, context: ScoringContext, scale: float, grid: DistanceGrid) -> None:
        """Add a note if the local goal was moved back."""
        super().set_grid(context, scale, grid)
        if isinstance(grid, MapGrid) and grid.stepped_back:
            context.notes.append(
                f"the plan's last cell in the local costmap is an obstacle: the local goal was moved back over "
                f"{grid.stepped_back} cells of the plan"
            )
