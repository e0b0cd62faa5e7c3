"""A global planner: from the start through via points to the goal."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from navstack.plugins import (
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

    points: list[list[float]] = param([], "via points [x, y] in the costmap's frame", unit="m")
    planner: str = param("astar", "global planner for each leg")


class ViaPointPlanner(GlobalPlanner):
    """Plans each leg with another registered planner and joins them."""

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
        """Path through the via points; raises the PlanningError of the leg that has none."""
        stops = [start, *(Pose2D(x, y, goal.yaw) for x, y in self.params.points), goal]
        legs = [
            self.planner.make_plan(costmap, a, b, footprint=footprint, keep_potential=keep_potential)
            for a, b in pairwise(stops)
        ]
        poses = np.vstack([leg.path.poses[:-1] for leg in legs] + [legs[-1].path.poses[-1:]])
        path, cost = Path(poses, costmap.frame), sum(leg.cost for leg in legs)
        return Plan(path, cost, legs[-1].goal, legs[-1].goal_moved_m, sum(leg.cells_expanded for leg in legs))
