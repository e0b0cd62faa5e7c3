"""Changes of planners and parameters at run time."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import navstack as nav
from navstack.bringup import reconfigure
from navstack.core import InputError, ParameterError, Pose2D, Twist2D
from navstack.move_base import GoalStatus, Mode, MoveBase
from navstack.move_base.states import NavEvent
from navstack.parameters import load_configuration
from navstack.plugins import RecoveryContext
from navstack.sim import SimulatedRobot

from .world import Bench, StraightPlanner, TurnAndGo, Waiting, occupied

GOAL = Pose2D(3.0, 0.0, 0.0)


def driving(**how: Any) -> tuple[Bench, Any]:
    bench = Bench(**how)
    handle = bench.move_base.send_goal(GOAL)
    bench.run_to(2.0)
    return bench, handle


@pytest.mark.parametrize("which", ["global", "local", "both"])
def test_new_planners_take_over_the_active_goal(which: str) -> None:
    bench, handle = driving()
    assert bench.robot.twist.vx > 0.0
    old = (bench.planner, bench.driver)
    new: dict[str, Any] = {}
    if which != "local":
        new["global_planner"] = StraightPlanner()
    if which != "global":
        new["local_planner"] = TurnAndGo()
    bench.move_base.reconfigure(**new)
    move_base = bench.move_base
    assert (move_base.state, move_base.plan, move_base.local_plan) == (Mode.PLANNING, None, None)
    assert (move_base.command, bench.robot.twist) == (Twist2D(), Twist2D())
    calls = (len(old[0].calls), old[1].calls)
    bench.run(handle)
    assert handle.status is GoalStatus.SUCCEEDED
    assert (len(old[0].calls) == calls[0]) == (which != "local")
    assert (old[1].calls == calls[1]) == (which != "global")
    for planner in new.values():
        assert planner.calls
    assert move_base.recovery_context.local_planner is move_base.local_planner
    assert [e.data["event"] for e in bench.listener.of("state")].count(NavEvent.PLANNERS_CHANGED.name) == 1


def test_a_planner_that_works_saves_a_goal_that_recovers() -> None:
    bench = Bench(planner=StraightPlanner(occupied), recoveries=[Waiting(lasts=30.0)])
    handle = bench.move_base.send_goal(GOAL)
    bench.run_to(7.0)
    assert bench.move_base.state is Mode.CLEARING
    bench.move_base.reconfigure(global_planner=StraightPlanner())
    assert bench.move_base.recovery is None
    assert bench.move_base.recovery_index == 0
    assert bench.robot.twist == Twist2D()
    bench.run(handle)
    assert handle.status is GoalStatus.SUCCEEDED


def test_a_new_planner_restarts_patience() -> None:
    bench = Bench(planner=StraightPlanner(occupied))
    handle = bench.move_base.send_goal(GOAL)
    bench.run_to(4.0)
    bench.move_base.reconfigure(global_planner=StraightPlanner(occupied))
    bench.run_to(8.0)
    assert not handle.is_done
    bench.run(handle)
    assert bench.robot.time == pytest.approx(9.0, abs=1.1)


class Picky(Waiting):
    """Rejects local planners marked as unfit."""

    def check(self, context: RecoveryContext) -> None:
        if getattr(context.local_planner, "unfit", False):
            raise ParameterError("not with this planner")


def test_an_error_changes_nothing() -> None:
    bench, handle = driving(recoveries=[Picky()])
    move_base = bench.move_base
    before = (move_base.state, move_base.plan, move_base.global_planner, move_base.local_planner, move_base.params)
    unfit = TurnAndGo()
    unfit.unfit = True  # type: ignore[attr-defined]
    other = move_base.params.model_copy(update={"controller_frequency": 7.0})
    with pytest.raises(ParameterError, match="not with this planner"):
        move_base.reconfigure(other, global_planner=StraightPlanner(), local_planner=unfit)
    with pytest.raises(InputError, match="is not a LocalPlanner"):
        move_base.reconfigure(other, global_planner=StraightPlanner(), local_planner=StraightPlanner())  # type: ignore[arg-type]
    after = (move_base.state, move_base.plan, move_base.global_planner, move_base.local_planner, move_base.params)
    assert after == before
    bench.run(handle)
    assert handle.status is GoalStatus.SUCCEEDED


def test_frequencies_change_immediately() -> None:
    bench, handle = driving()
    params = bench.move_base.params.model_copy(update={"controller_frequency": 10.0, "planner_frequency": 4.0})
    commands, plans = len(bench.robot.commands), len(bench.planner.calls)  # type: ignore[attr-defined]
    bench.move_base.reconfigure(params)
    assert bench.move_base.state is Mode.CONTROLLING
    bench.run_to(4.0)
    assert len(bench.robot.commands) - commands == pytest.approx(20, abs=1)
    assert len(bench.planner.calls) - plans == pytest.approx(8, abs=1)  # type: ignore[attr-defined]
    bench.move_base.reconfigure(params.model_copy(update={"planner_frequency": 0.0}))
    bench.run_to(4.2)
    plans = len(bench.planner.calls)  # type: ignore[attr-defined]
    bench.run(handle)
    assert handle.status is GoalStatus.SUCCEEDED
    assert len(bench.planner.calls) <= plans + 1  # type: ignore[attr-defined]


def test_patience_changes_immediately() -> None:
    bench = Bench(planner=StraightPlanner(occupied))
    handle = bench.move_base.send_goal(GOAL)
    bench.run_to(1.0)
    bench.move_base.reconfigure(bench.move_base.params.model_copy(update={"planner_patience": 2.0}))
    bench.run(handle)
    assert bench.robot.time == pytest.approx(2.0, abs=0.5)


@pytest.mark.parametrize("on", [True, False])
def test_costmaps_stop_and_start(on: bool) -> None:
    bench = Bench(shutdown_costmaps=not on)
    bench.run_to(2.0)
    count = len(bench.local_costmap.updates)
    bench.move_base.reconfigure(bench.move_base.params.model_copy(update={"shutdown_costmaps": on}))
    assert bench.move_base.next_due(2.0) == (float("inf") if on else pytest.approx(2.0))
    if not on:
        bench.run_to(3.0)
    assert (len(bench.local_costmap.updates) > count) != on


def test_without_a_goal_the_robot_stands_still() -> None:
    bench = Bench()
    bench.run_to(1.0)
    bench.move_base.reconfigure(global_planner=StraightPlanner(), local_planner=TurnAndGo())
    assert bench.move_base.state is Mode.IDLE
    assert bench.run(bench.move_base.send_goal(GOAL)).status is GoalStatus.SUCCEEDED


def test_from_a_configuration() -> None:
    first = load_configuration(["turtlebot"])
    grid = nav.load_map(nav.map_path("office"))
    robot = nav.simulated_robot(first, grid, Pose2D(2.0, 7.45, 0.0))
    move_base = nav.build_move_base(first, robot, static_map=grid)
    planners = (move_base.global_planner, move_base.local_planner)
    reconfigure(move_base, first)
    assert (move_base.global_planner, move_base.local_planner) == planners
    second = load_configuration(
        ["turtlebot"], overrides=["base_global_planner=global_planner/GlobalPlanner", "planner_patience=7.0"]
    )
    reconfigure(move_base, second)
    assert type(move_base.global_planner) is second.global_planner.cls
    assert move_base.global_planner is not planners[0]
    assert move_base.local_planner is planners[1]
    assert move_base.params.planner_patience == 7.0


def office(*overrides: str) -> tuple[MoveBase, SimulatedRobot]:
    grid = nav.load_map(nav.map_path("office"))
    configuration = load_configuration(["turtlebot"], overrides=overrides)
    robot = nav.simulated_robot(configuration, grid, Pose2D(2.0, 7.45, 0.0))
    return nav.build_move_base(configuration, robot, static_map=grid), robot


def drive(move_base: MoveBase, robot: SimulatedRobot, until: float) -> None:
    while robot.time < until:
        robot.advance_to(move_base.next_due(robot.time))
        move_base.tick(robot.time)


LIVE = (
    "global_costmap/inflation_layer/inflation_radius=0.3",
    "global_costmap/inflation_layer/cost_scaling_factor=3.0",
    "global_costmap/obstacle_layer/scan/obstacle_range=1.0",
    "global_costmap/update_frequency=4.0",
    "local_costmap/inflation_layer/inflation_radius=0.4",
    "local_costmap/width=5.0",
    "local_costmap/height=5.0",
    "controller_frequency=10.0",
    "planner_frequency=2.0",
)


def test_costmaps_reconfigured_while_driving_equal_new_ones() -> None:
    move_base, robot = office()
    handle = move_base.send_goal(Pose2D(8.0, 7.4, 0.0))
    drive(move_base, robot, 3.0)
    static = [layer.name for layer in move_base.global_costmap.layers]
    reconfigure(move_base, load_configuration(["turtlebot"], overrides=LIVE))
    assert not handle.is_done
    drive(move_base, robot, 3.05)
    fresh, still = office(*LIVE)
    drive(fresh, still, 0.05)
    # walls of the map far from the observations: the costs of a costmap built with these parameters
    ours, theirs = move_base.global_costmap.master.data, fresh.global_costmap.master.data
    far = np.s_[: ours.shape[0] // 3, ours.shape[1] // 2 :]
    assert np.array_equal(ours[far], theirs[far])
    before, _ = office()
    drive(before, _, 0.05)
    assert not np.array_equal(ours[far], before.global_costmap.master.data[far])
    assert move_base.local_costmap.master.data.shape == (100, 100)
    assert [layer.name for layer in move_base.global_costmap.layers] == static
    layer = move_base.global_costmap.layers[1]
    assert layer.buffers[0].params.obstacle_range == 1.0  # type: ignore[attr-defined]
    # and it continues at the new frequency
    times: list[float] = []
    while not handle.is_done:
        robot.advance_to(move_base.next_due(robot.time))
        move_base.tick(robot.time)
        if move_base.last_tick.global_window is not None:
            times.append(robot.time)
    assert handle.status is GoalStatus.SUCCEEDED
    gaps = np.diff(times)
    assert gaps.mean() == pytest.approx(0.25, abs=0.01)


def test_another_footprint_while_driving() -> None:
    move_base, robot = office()
    move_base.send_goal(Pose2D(8.0, 7.4, 0.0))
    drive(move_base, robot, 2.0)
    small = move_base.local_costmap.footprint.circumscribed_radius
    bigger = ("global_costmap/robot_radius=0.25", "local_costmap/robot_radius=0.25")
    reconfigure(move_base, load_configuration(["turtlebot"], overrides=bigger))
    assert move_base.local_costmap.footprint.circumscribed_radius == pytest.approx(small + 0.05, abs=0.01)
    inscribed = (move_base.global_costmap.master.data == 253).sum()
    fresh, still = office(*bigger)
    drive(fresh, still, 0.05)
    # except for the observations while driving
    assert inscribed == pytest.approx((fresh.global_costmap.master.data == 253).sum(), rel=0.05)


@pytest.mark.parametrize(
    ("override", "message"),
    [
        (
            "global_costmap/robot_base_frame=base_link",
            "global_costmap/robot_base_frame cannot be changed at run time",
        ),
        ("local_costmap/rolling_window=false", "local_costmap/rolling_window cannot be changed"),
        ("global_costmap/obstacle_layer/scan/topic=other", "global_costmap/obstacle_layer/sources cannot be changed"),
    ],
)
def test_a_fixed_costmap_parameter_changes_nothing(override: str, message: str) -> None:
    move_base, robot = office()
    drive(move_base, robot, 0.1)
    before = move_base.global_costmap.params, move_base.params, move_base.global_costmap.master.data.copy()
    with pytest.raises(InputError, match=message):
        reconfigure(
            move_base,
            load_configuration(
                ["turtlebot"],
                overrides=[override, "planner_patience=9.0", "global_costmap/inflation_layer/inflation_radius=0.2"],
            ),
        )
    assert (move_base.global_costmap.params, move_base.params) == before[:2]
    assert np.array_equal(move_base.global_costmap.master.data, before[2])
