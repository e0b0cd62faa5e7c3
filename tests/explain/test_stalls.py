"""Controllers that wait before a wall or a door: the explanation names the cause, and its fix drives."""

from __future__ import annotations

import pytest

import navstack as nav
from navstack.parameters import load_configuration

pytestmark = pytest.mark.slow


def drive(ahead_m: float) -> nav.SimulationResult:
    """From the meeting room of the office through its door, whose path turns back behind the wall."""
    overrides = [f"FollowPath.forward_prune_distance={ahead_m}", "local_costmap.width=5", "local_costmap.height=5"]
    robot = load_configuration(["nav2_turtlebot"], overrides=overrides)
    return nav.simulate("office", robot=robot, start=(16.9, 9.6, 1.57), goals=[(20.6, 2.2, -1.57)], time_limit_s=40.0)


def test_a_plan_that_ends_behind_a_wall_is_named_as_the_cause() -> None:
    result = drive(2.5)
    assert not result.goals[0].succeeded
    told = " ".join(result.explain(goal=1).split())
    assert told.count("behind an obstacle") == 1
    assert "GoalDist and GoalAlign measure through obstacles, as in Nav2; forward_prune_distance: " in told
    fix = float(told.partition("forward_prune_distance: ")[2].split()[0])
    assert 0.5 <= fix < 2.5
    assert drive(fix).goals[0].succeeded


def test_a_robot_that_arrives_has_no_such_line() -> None:
    assert "behind an obstacle" not in drive(1.0).explain(goal=1)


CRITICS = (
    "ConstraintCritic, ObstaclesCritic, GoalCritic, GoalAngleCritic, PathAlignCritic, PathFollowCritic, PathAngleCritic, "
    "PreferForwardCritic"
)


def through_a_door(margin_m: float) -> nav.SimulationResult:
    """MPPI with Nav2's ObstaclesCritic, through a door that is 0.9 m wide."""
    critic = "MPPIController/ObstaclesCritic"
    overrides = [
        f"MPPIController/critics=[{CRITICS}]",
        f"{critic}/collision_margin_distance={margin_m}",
        f"{critic}/critical_weight=40.0",
        "oscillation_timeout=0.0",
    ]
    robot = load_configuration(["turtlebot_mppi"], overrides=overrides)
    return nav.simulate("office", robot=robot, goals=[(6.2, 12.0, 1.57)], time_limit_s=40.0)


def test_a_margin_wider_than_a_door_is_named_as_the_cause() -> None:
    result = through_a_door(0.35)
    assert not result.goals[0].succeeded
    told = " ".join(result.explain(goal=1).split())
    assert told.count("less than collision_margin_distance = 0.35 m of ObstaclesCritic") == 1
    fix = float(told.partition("critical_weight; set it to ")[2].partition(",")[0])
    fixed = through_a_door(fix)
    assert fixed.goals[0].succeeded
    assert "collision_margin_distance" not in fixed.explain(goal=1)
