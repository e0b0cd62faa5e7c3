"""carrot_planner: straight at the goal, as far as the footprint fits (carrot_planner/src/carrot_planner.cpp)."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from navstack.core import INSCRIBED, LETHAL, UNKNOWN, Costmap, Footprint, Path, Pose2D, angle_between, normalize_angle
from navstack.core.errors import GoalOccupiedError
from navstack.core.parameters import ParamModel
from navstack.global_planner import ends
from navstack.global_planner.cost_rule import navfn_rule
from navstack.interfaces import GlobalPlanner, Plan
from navstack.plugins import GLOBAL_PLANNERS

_SCALE_STEP = 0.01  # carrot_planner.cpp, dScale


class CarrotPlannerParams(ParamModel):
    """Parameters of CarrotPlanner: both are read by ROS and used by nothing."""

    NO_EFFECT: ClassVar[Mapping[str, str]] = {
        "step_size": "read by CarrotPlanner, never used: the goal is pulled back by hundredths of the distance",
        "min_dist_from_robot": "read by CarrotPlanner, never used",
    }


@GLOBAL_PLANNERS.register("carrot_planner", aliases=("carrot_planner/CarrotPlanner",))
class CarrotPlanner(GlobalPlanner):
    """carrot_planner: the goal, pulled back along the straight line to the start until the robot fits there.

    The plan is the start and that point, whose heading is turned in proportion. What lies between is not looked at: that is
    the local planner's business. The robot fits where no cell under its outline is lethal or unknown and that of its centre
    is not inscribed either; without a footprint only the centre's cell is looked at. `Plan.cost` is the length in metres.
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
        """Start and the point nearest to the goal where the robot fits.

        Raises StartOutsideMapError, GoalOutsideMapError, InputError for a pose that is not finite, and GoalOccupiedError when the
        robot fits nowhere on the line.
        """
        del keep_potential
        began = time.perf_counter()
        start, goal = ends.with_yaw_in_range(start), ends.with_yaw_in_range(goal)
        _, goal_cell = ends.cells_of(costmap, start, goal)
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
                notes = (f"the goal is pulled back by {moved:.2f} m to where the robot fits",) if moved > 0.0 else ()
                poses = np.array([start, target], dtype=np.float64)
                length = start.distance_to(target)
                took = time.perf_counter() - began
                return Plan(Path(poses, costmap.frame), length, target, moved, 0, None, notes, took)
            scale = round(scale - _SCALE_STEP, 10)
        data = ends.occupied_data(costmap, navfn_rule(False), goal_cell, ring=False)
        raise GoalOccupiedError(
            f"the robot fits nowhere on the straight line from ({start.x:.3f}, {start.y:.3f}) to ({goal.x:.3f}, {goal.y:.3f})",
            **{**data, "x": goal.x, "y": goal.y},
        )


def _fits(costmap: Costmap, pose: Pose2D, footprint: Footprint | None) -> bool:
    centre = costmap.cost_at(pose.x, pose.y)
    if centre is None or centre in (INSCRIBED, LETHAL, UNKNOWN):
        return False
    if footprint is None:
        return True
    c, s = math.cos(pose.yaw), math.sin(pose.yaw)
    corners = np.asarray(footprint.vertices, dtype=np.float64) @ np.array([[c, s], [-s, c]]) + (pose.x, pose.y)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        # twice per cell: no cell is passed but by a corner
        count = max(2, math.ceil(2.0 * float(np.hypot(*(b - a))) / costmap.geometry.resolution) + 1)
        for t in np.linspace(0.0, 1.0, count):
            cost = costmap.cost_at(*(a + t * (b - a)))
            if cost is None or cost in (LETHAL, UNKNOWN):
                return False
    return True
