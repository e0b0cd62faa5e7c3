"""smac_2d: Nav2's names, and what they mean for astar."""

from __future__ import annotations

import math

import numpy as np
import pytest

from navstack.core import Costmap, GridGeometry, PlanningTimeoutError, Pose2D
from navstack.global_planner import AStarParams, AStarPlanner, Smac2DParams, Smac2DPlanner
from navstack.parameters import load_configuration


def costmap() -> Costmap:
    rng = np.random.default_rng(2)
    data = rng.integers(0, 200, (60, 80)).astype(np.uint8)
    data[20:40, 30:34] = 254
    return Costmap(GridGeometry(80, 60, 0.05), data)


START, GOAL = Pose2D(0.5, 1.5, 0.0), Pose2D(3.5, 1.4, 1.0)


def test_the_same_path_as_astar() -> None:
    ours = Smac2DPlanner(Smac2DParams(cost_travel_multiplier=3.0)).make_plan(costmap(), START, GOAL)
    theirs = AStarPlanner(AStarParams(neutral_cost=1.0, cost_factor=3.0 / 252.0)).make_plan(costmap(), START, GOAL)
    assert ours.path.poses.tobytes() == theirs.path.poses.tobytes()
    quadratic = Smac2DPlanner(Smac2DParams(cost_travel_multiplier=3.0, use_quadratic_cost_penalty=True))
    assert quadratic.make_plan(costmap(), START, GOAL).cost < ours.cost


def test_final_approach_orientation() -> None:
    plan = Smac2DPlanner(Smac2DParams(use_final_approach_orientation=True)).make_plan(costmap(), START, GOAL)
    step = plan.path.poses[-1, :2] - plan.path.poses[-2, :2]
    assert plan.path[-1].yaw == pytest.approx(math.atan2(step[1], step[0])) == plan.goal.yaw
    assert plan.path[-1].distance_to(GOAL) == 0.0


def test_limit() -> None:
    with pytest.raises(PlanningTimeoutError, match="max_iterations = 10 cells"):
        Smac2DPlanner(Smac2DParams(max_iterations=10)).make_plan(costmap(), START, GOAL)
    assert Smac2DPlanner(Smac2DParams(max_iterations=0)).make_plan(costmap(), START, GOAL).length_m > 3.0


def test_yaml_of_nav2() -> None:
    values = [
        "base_global_planner=nav2_smac_planner::SmacPlanner2D",
        "smac_2d.cost_travel_multiplier=2.0",
        "smac_2d.max_planning_time=2.0",
        "smac_2d.smoother.w_data=0.2",
    ]
    configuration = load_configuration(["turtlebot"], overrides=values)
    assert configuration.global_planner.cls is Smac2DPlanner
    assert configuration.global_planner.params.cost_travel_multiplier == 2.0
