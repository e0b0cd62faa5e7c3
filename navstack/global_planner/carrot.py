"""carrot_planner: straight toward the goal, as far as the footprint fits (carrot_planner/src/carrot_planner.cpp)."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from navstack.core import (
    INSCRIBED,
    LETHAL,
    UNKNOWN,
    Costmap,
    Footprint,
    GoalOccupiedError,
    Path,
    Pose2D,
    angle_between,
    normalize_angle,
)
from navstack.global_planner._search.cells import SearchSpace, navfn_costs
from navstack.global_planner._search.planning_errors import occupied_data
from navstack.global_planner._search.start_goal import cells_of, require_finite, with_yaw_in_range
from navstack.plugins import GLOBAL_PLANNERS, GlobalPlanner, ParamModel, Plan

_SCALE_STEP = 0.01  # carrot_planner.cpp, dScale


class CarrotPlannerParams(ParamModel):
    """Parameters of CarrotPlanner: ROS reads both and uses neither."""

    NO_EFFECT: ClassVar[Mapping[str, str]] = {
        "step_size": "read by CarrotPlanner, never used: the goal is moved back by hundredths of the distance",
        "min_dist_from_robot": "read by CarrotPlanner, never used",
    }


@GLOBAL_PLANNERS.register("carrot_planner", aliases=("carrot_planner/CarrotPlanner",))
class CarrotPlanner(GlobalPlanner):
    """carrot_planner: the goal, moved back along the straight line to the start until the robot fits there.

    The plan consists of the start and that pose, whose heading is interpolated. A goal outside the costmap is moved back, too.
    The cells between them are not checked: as in C++ the plan may pass through walls, and the local planner must stop. The
    robot fits if no cell under the border of its footprint is lethal or unknown and the cell of its center is not inscribed
    either; without a footprint only the cell of the center is checked. `Plan.cost` is the length in meters.
    """

    Params = CarrotPlannerParams

    def __init__(self, params: CarrotPlannerParams | None = None) -> None:
        super().__init__(params or CarrotPlannerParams())

    def make_plan(
        self,
        costmap: Costmap,
        start: Pose2D,
        goal: Pose2D,
        *,
        footprint: Footprint | None = None,
        keep_potential: bool = False,
    ) -> Plan:
        """Plan to the pose nearest to the goal where the robot fits, also for a goal outside the costmap.

        Raises StartOutsideMapError, InputError for a pose that is not finite, and GoalOccupiedError when the robot does not
        fit anywhere on the line (GoalOutsideMapError if the goal is outside).
        """
        del keep_potential
        began = time.perf_counter()
        start, goal = with_yaw_in_range(start), with_yaw_in_range(goal)
        require_finite(start, goal)
        cells_of(costmap, start, start)
        goal_cell = costmap.geometry.world_to_cell(goal.x, goal.y)
        turn = angle_between(start.yaw, goal.yaw)
        scale = 1.0
        while scale >= 0.0:
            target = Pose2D(
                start.x + scale * (goal.x - start.x),
                start.y + scale * (goal.y - start.y),
                normalize_angle(start.yaw + scale * turn),
            )
            if _fits(costmap, target, footprint):
                moved = goal.distance_to(target)
                outside = ", which is outside the costmap," if goal_cell is None else ""
                note = f"the goal{outside} was moved back by {moved:.2f} m to where the robot fits"
                notes = (note,) if moved > 0.0 else ()
                poses = np.array([start, target], dtype=np.float64)
                length = start.distance_to(target)
                took = time.perf_counter() - began
                return Plan(Path(poses, costmap.frame), length, target, moved, notes=notes, took_s=took)
            scale = round(scale - _SCALE_STEP, 10)
        if goal_cell is None:
            cells_of(costmap, start, goal)
        assert goal_cell is not None
        data = occupied_data(SearchSpace(costmap, navfn_costs(False), border_blocked=False), goal_cell)
        raise GoalOccupiedError(
            f"the robot does not fit anywhere on the straight line from ({start.x:.3f}, {start.y:.3f}) to "
            f"({goal.x:.3f}, {goal.y:.3f})",
            **{**data, "x": goal.x, "y": goal.y},
        )


def _fits(costmap: Costmap, pose: Pose2D, footprint: Footprint | None) -> bool:
    center = costmap.cost_at(pose.x, pose.y)
    if center is None or center in (INSCRIBED, LETHAL, UNKNOWN):
        return False
    if footprint is None:
        return True
    c, s = math.cos(pose.yaw), math.sin(pose.yaw)
    corners = np.asarray(footprint.vertices, dtype=np.float64) @ np.array([[c, s], [-s, c]]) + (pose.x, pose.y)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        # two samples per cell: a cell can only be missed at a corner
        count = max(2, math.ceil(2.0 * float(np.hypot(*(b - a))) / costmap.geometry.resolution) + 1)
        for t in np.linspace(0.0, 1.0, count):
            cost = costmap.cost_at(*(a + t * (b - a)))
            if cost is None or cost in (LETHAL, UNKNOWN):
                return False
    return True
