"""DWB waits before a wall where its plan turns back behind it: the explanation names the cause, and its fix drives."""

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
