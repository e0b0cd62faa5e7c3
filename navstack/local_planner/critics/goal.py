"""Moves the robot along the plan (MapGridCostFunction over the goal grid)."""

from __future__ import annotations

from typing import ClassVar

from navstack.local_planner.map_grid import CENTER_CODES, MapGrid, MapGridCritic, RosDistro, distance_weight
from navstack.plugins import CRITICS, ParamModel, ScoringContext, param


class GoalParams(ParamModel):
    """Weight of the distance to the local goal."""

    FROM_NAVSTACK = frozenset({"ros_distro"})

    goal_distance_bias: float = param(
        0.8, "weight of the distance to the local goal, per meter (24 before 2018: see ros_distro)", ge=0.0
    )
    ros_distro: RosDistro = param("noetic", "scoring scale of noetic, or of the releases before 2018")


@CRITICS.register("goal")
class GoalCritic(MapGridCritic[GoalParams]):
    """Distance (cells, around obstacles) from the rollout's last point to the plan's last cell in the window."""

    Params: ClassVar[type[ParamModel]] = GoalParams
    CODES: ClassVar[dict[int, str]] = CENTER_CODES
    step_back = True
    """ROS differs: a local goal in an obstacle cell would leave every other cell unreachable, every sample rejected (parity 27);
    it is replaced by the last free cell of the plan before it."""

    def weight(self, context: ScoringContext) -> float:
        """`goal_distance_bias` times the resolution; half of that before 2018."""
        p = self.params
        return distance_weight(p.goal_distance_bias, context.costmap.geometry.resolution, p.ros_distro)

    def build(self, context: ScoringContext) -> MapGrid:
        """Distances to the local goal; adds a note if it was moved back."""
        pose = context.state.pose
        grid = self._builder.build(context, context.plan, pose[:2], last_only=True, step_back=self.step_back)
        if grid.stepped_back:
            context.notes.append(
                f"the plan's last cell in the local costmap is an obstacle: the local goal was moved back over "
                f"{grid.stepped_back} cells of the plan"
            )
        return grid
