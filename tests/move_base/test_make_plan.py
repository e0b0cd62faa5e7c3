from __future__ import annotations

import math

import numpy as np
import pytest

from navstack.core import Costmap, FrameError, GoalOccupiedError, InputError, Pose2D
from navstack.move_base.errors import BusyError
from navstack.move_base.planning import rings
from navstack.plugins import Plan

from .world import Bench, StraightPlanner, occupied


class Picky(StraightPlanner):
    """Plans only to goals at x >= `x`; stores the costmap of the request."""

    def __init__(self, x: float) -> None:
        super().__init__()
        self.x = x
        self.seen: Costmap | None = None

    def make_plan(self, costmap: Costmap, start: Pose2D, goal: Pose2D, **kwargs: object) -> Plan:
        self.seen = costmap
        self.calls.append(goal)
        if goal.x < self.x - 1e-9:
            raise GoalOccupiedError(f"blocked at {goal.x:.2f}")
        self.calls.pop()
        return super().make_plan(costmap, start, goal)


def test_from_the_robot_and_from_another_start() -> None:
    bench = Bench(start=Pose2D(0.5, 0.5))
    bench.tick()
    plan = bench.move_base.make_plan(Pose2D(2.0, 0.5))
    assert plan.path[0] == pytest.approx((0.5, 0.5, 0.0))
    assert plan.path.length == pytest.approx(1.5)
    assert bench.move_base.make_plan(Pose2D(2.0, 0.5), Pose2D(1.0, 0.5)).path.length == pytest.approx(1.0)
    assert not bench.robot.commands


def test_busy_while_a_goal_is_active() -> None:
    bench = Bench()
    bench.move_base.send_goal(Pose2D(3.0, 0.0))
    bench.run_to(1.0)
    with pytest.raises(BusyError, match="inactive state to make a plan for an external user"):
        bench.move_base.make_plan(Pose2D(1.0, 0.0))


def test_the_costmap_around_the_robot_is_cleared_in_a_copy() -> None:
    for clear in (True, False):
        planner = Picky(-9.0)
        bench = Bench(planner=planner, make_plan_clear_costmap=clear, clearing_radius=0.5)
        bench.tick()
        bench.global_costmap.master.data[:] = 254
        bench.move_base.make_plan(Pose2D(2.0, 0.0))
        assert planner.seen is not None
        free = planner.seen.data == 0
        assert (bench.global_costmap.master.data == 254).all()
        if clear:
            # a square of side 2 * clearing_radius, in whole cells
            assert free.sum() == pytest.approx((1.0 / 0.05) ** 2, rel=0.11)
            assert free[100, 100]
        else:
            assert not free.any()


def test_within_tolerance_and_with_the_goal_appended() -> None:
    goal = Pose2D(2.0, 1.0, 0.7)
    for add in (True, False):
        bench = Bench(planner=Picky(2.3), make_plan_add_unreachable_goal=add)
        bench.tick()
        plan = bench.move_base.make_plan(goal, tolerance=0.5)
        # rings of 3 cells: 0.15, 0.30
        assert plan.goal_moved_m == pytest.approx(0.3)
        assert plan.goal == pytest.approx((2.3, 1.0, 0.7))
        assert plan.path[len(plan.path) - 1] == pytest.approx(tuple(goal) if add else (2.3, 1.0, 0.7))
        assert "GOAL_OCCUPIED" in plan.notes[-1]


def test_without_a_plan_the_error_is_that_of_the_goal_itself() -> None:
    bench = Bench(planner=StraightPlanner(occupied))
    bench.tick()
    with pytest.raises(GoalOccupiedError) as caught:
        bench.move_base.make_plan(Pose2D(2.0, 1.0), tolerance=0.5)
    assert caught.value.data["call"] == 0


@pytest.mark.parametrize("tolerance", [-1.0, math.nan, math.inf])
def test_an_invalid_tolerance(tolerance: float) -> None:
    with pytest.raises(InputError, match="tolerance"):
        Bench().move_base.make_plan(Pose2D(1.0, 0.0), tolerance=tolerance)


def test_without_a_robot_pose_a_start_is_required() -> None:
    bench = Bench()
    bench.robot.frames.remove("base_link")
    with pytest.raises(FrameError):
        bench.move_base.make_plan(Pose2D(1.0, 0.0))
    assert bench.move_base.make_plan(Pose2D(1.0, 0.0), Pose2D(0.0, 0.0)).path.length == pytest.approx(1.0)


def test_rings_are_complete_and_grow() -> None:
    found = rings(Pose2D(1.0, 2.0, 0.5), 0.1, 1.0)
    # (2 n + 1)^2 - 1 poses for n rings of 0.3 m
    assert len(found) == 7 * 7 - 1
    grid = {(round((p.x - 1.0) / 0.3), round((p.y - 2.0) / 0.3)) for p, _ in found}
    assert grid == {(x, y) for x in range(-3, 4) for y in range(-3, 4)} - {(0, 0)}
    size = [max(abs(p.x - 1.0), abs(p.y - 2.0)) for p, _ in found]
    assert np.all(np.diff(size) > -1e-9)
    assert all(d == pytest.approx(math.hypot(p.x - 1.0, p.y - 2.0)) for p, d in found)
    assert rings(Pose2D(0.0, 0.0), 0.1, 0.0) == []
    assert len(rings(Pose2D(0.0, 0.0), 0.1, 0.2)) == 8  # the tolerance is smaller than three cells


def test_clear_costmaps() -> None:
    bench = Bench()
    assert bench.move_base.clear_costmaps() == 4 * 7
    for costmap in (bench.local_costmap, bench.global_costmap):
        assert [layer.resets for layer in costmap.layers] == [[(None, False)]] * 2
