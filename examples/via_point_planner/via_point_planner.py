"""A global planner: A* from the start to a via point, then to the goal."""

from __future__ import annotations

import numpy as np

from navstack.plugin import (
    GLOBAL_PLANNERS,
    Costmap,
    Footprint,
    GlobalPlanner,
    ParamModel,
    Path,
    Plan,
    Pose2D,
    param,
)


class ViaPointParams(ParamModel):
    """Namespace `ViaPointPlanner`."""

    x: float = param(0.0, "via point in the costmap's frame", unit="m")
    y: float = param(0.0, "via point in the costmap's frame", unit="m")
    planner: str = param("astar", "global planner for both legs")


class ViaPointPlanner(GlobalPlanner):
    """Plans both legs with another registered planner and joins them."""

    Params = ViaPointParams
    PLUGIN_ALIASES = ("via_point_planner/ViaPointPlanner",)

    def __init__(self, params: ViaPointParams) -> None:
        super().__init__(params)
        cls = GLOBAL_PLANNERS.get(params.planner).cls
        self.planner = cls(cls.Params())

    def make_plan(
        self,
        costmap: Costmap,
        start: Pose2D,
        goal: Pose2D,
        *,
        footprint: Footprint | None = None,
        keep_potential: bool = False,
    ) -> Plan:
        """Path through the via point; raises the PlanningError of the leg that has none."""
        via = Pose2D(self.params.x, self.params.y, goal.yaw)
        first = self.planner.make_plan(costmap, start, via, footprint=footprint)
        second = self.planner.make_plan(costmap, via, goal, footprint=footprint, keep_potential=keep_potential)
        poses = np.vstack((first.path.poses[:-1], second.path.poses))
        cells = first.cells_expanded + second.cells_expanded
        return Plan(Path(poses, costmap.frame), first.cost + second.cost, second.goal, second.goal_moved_m, cells)
