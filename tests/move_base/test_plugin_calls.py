"""Errors of plugins: which plugin, which line, and the traceback."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from navstack.core import (
    Costmap,
    GridGeometry,
    InternalError,
    NavError,
    NoValidPathError,
    Pose2D,
    RecoveryError,
    RobotState,
    Twist2D,
)
from navstack.move_base import GoalStatus, plugin_calls
from navstack.plugins import Plan, RecoveryContext
from navstack.record.recorder import render_log
from tests.move_base.world import Bench, StraightPlanner, TurnAndGo, Waiting

HERE = "tests/move_base/test_plugin_calls.py"
GOAL = Pose2D(2.0, 0.0)


def broken(n: int) -> None:
    raise ValueError(f"call {n} failed")


def broken_in_a_library(n: int) -> None:
    np.linalg.inv(np.zeros((2, 2)))


def line_of(function: Callable[..., Any]) -> int:
    """The line of the only statement of a function."""
    return function.__code__.co_firstlineno + 1


@pytest.mark.parametrize(
    ("fault", "exception"), [(broken, "ValueError: call 0 failed"), (broken_in_a_library, "LinAlg")]
)
def test_the_error_names_plugin_exception_file_and_line(fault: Callable[[int], None], exception: str) -> None:
    costmap = Costmap(GridGeometry(10, 10, 0.05, 0.0, 0.0), frame="map")
    with pytest.raises(InternalError) as caught:
        plugin_calls.make_plan(StraightPlanner(fault), costmap, Pose2D(0.0, 0.0), GOAL, None)
    error = caught.value
    assert error.message.startswith(f"StraightPlanner raised {exception}")
    # the plugin's own line, also if a library raised
    assert error.message.endswith(f" ({HERE}:{line_of(fault)})")
    assert "\n" not in error.message
    assert error.data["plugin"] == "StraightPlanner"
    assert error.data["location"] == f"{HERE}:{line_of(fault)}"
    trace = error.data["traceback"]
    assert trace.startswith("Traceback (most recent call last):\n")
    assert f'File "{HERE}", line {line_of(fault)}, in {fault.__name__}' in trace
    assert re.search(rf"\n\S*{exception}", trace)
    assert "navstack/move_base/plugin_calls" not in trace


def test_an_exception_without_text() -> None:
    with pytest.raises(InternalError, match=r"^Waiting raised KeyError \(unknown location\)$"):
        raise plugin_calls.plugin_error(type("Waiting", (), {})(), KeyError())


def test_errors_of_navstack_are_not_wrapped() -> None:
    def occupied(n: int) -> None:
        raise NoValidPathError("the goal is behind a wall", call=n)

    costmap = Costmap(GridGeometry(10, 10, 0.05, 0.0, 0.0), frame="map")
    with pytest.raises(NoValidPathError, match=r"^the goal is behind a wall$"):
        plugin_calls.make_plan(StraightPlanner(occupied), costmap, Pose2D(0.0, 0.0), GOAL, None)


class BrokenSetPlan(TurnAndGo):
    def set_plan(self, plan: Any, goal: Pose2D) -> None:
        raise IndexError("no poses")


class BrokenStart(Waiting):
    def start(self, context: RecoveryContext, now: float) -> None:
        raise KeyError("speed")


class BrokenFollowUp(Waiting):
    def follow_up(self, state: RobotState, now: float) -> bool:
        raise KeyError("limit")


def failures(bench: Bench, kind: str) -> list[dict[str, Any]]:
    return [event.data for event in bench.listener.of(kind)]


def test_planners_in_a_run() -> None:
    bench = Bench(planner=StraightPlanner(broken))
    handle = bench.run(bench.move_base.send_goal(GOAL))
    assert f"({HERE}:{line_of(broken)})" in handle.result.message
    assert all("Traceback" in data["traceback"] for data in failures(bench, "plan_failed"))
    bench = Bench(driver=TurnAndGo(broken))
    handle = bench.run(bench.move_base.send_goal(GOAL))
    assert handle.result.message.startswith("TurnAndGo raised ValueError: call ")
    assert all("Traceback" in data["traceback"] for data in failures(bench, "control_failed"))


def test_set_plan_that_raises() -> None:
    bench = Bench(driver=BrokenSetPlan())
    handle = bench.run(bench.move_base.send_goal(GOAL))
    assert handle.text == "Failed to pass global plan to the controller."
    assert (
        handle.result.message == f"BrokenSetPlan raised IndexError: no poses ({HERE}:{line_of(BrokenSetPlan.set_plan)})"
    )
    assert "Traceback" in handle.result.data["error"]["traceback"]


def test_a_recovery_that_raises_in_start() -> None:
    bench = Bench(planner=StraightPlanner(broken), recoveries=[BrokenStart("first")])
    handle = bench.run(bench.move_base.send_goal(GOAL))
    assert handle.result.recovery_names == ("first",)
    (event,) = bench.listener.of("recovery")
    assert event.text == f"first raised KeyError: 'speed' ({HERE}:{line_of(BrokenStart.start)})"
    assert "Traceback" in event.data["traceback"]


def test_a_recovery_that_raises_in_follow_up() -> None:
    planner = StraightPlanner(lambda n: broken(n) if n < 30 else None)
    bench = Bench(planner=planner, recoveries=[BrokenFollowUp("slow")])
    assert bench.run(bench.move_base.send_goal(GOAL)).status is GoalStatus.SUCCEEDED
    (event,) = bench.listener.of("warning")
    assert event.text == f"slow raised KeyError: 'limit' ({HERE}:{line_of(BrokenFollowUp.follow_up)})"
    assert "Traceback" in event.data["traceback"]


def test_the_log_of_a_run_has_each_traceback_once() -> None:
    bench = Bench(planner=StraightPlanner(lambda n: broken(0)))
    bench.run(bench.move_base.send_goal(GOAL))
    events = [{"time": e.time, "kind": e.kind, "text": e.text, "data": e.data} for e in bench.listener.events]
    text = render_log({"version": 1, "scenario": {}, "results": []}, events)
    assert text.count("Traceback (most recent call last):") == 1
    assert f'    File "{HERE}", line {line_of(broken)}, in broken\n' in text


def test_the_robot_and_the_costmaps() -> None:
    bench = Bench()

    def fails(now: float) -> None:
        raise OSError("disk full")

    bench.global_costmap.fails = fails
    bench.robot.broken = lambda what: fails(0.0)
    bench.move_base.tick(0.0)
    texts = [event.text for event in bench.listener.of("warning")]
    where = rf"\({re.escape(HERE)}:{line_of(fails)}\)"
    assert re.fullmatch(rf"no scans from the robot: KinematicRobot raised OSError: disk full {where}", texts[0])
    assert re.fullmatch(
        rf"global_costmap could not be updated: global_costmap raised OSError: disk full {where}", texts[1]
    )


def test_results_are_checked() -> None:
    costmap = Costmap(GridGeometry(10, 10, 0.05, 0.0, 0.0), frame="map")
    with pytest.raises(NavError, match="StraightPlanner returned a int, not a Plan; please report this to its author"):
        plugin_calls.make_plan(StraightPlanner(lambda n: 3), costmap, Pose2D(0.0, 0.0), GOAL, None)
    with pytest.raises(RecoveryError):
        plugin_calls.call(Waiting(), _raise_recovery_error)
    assert isinstance(plugin_calls.make_plan(StraightPlanner(), costmap, Pose2D(0.0, 0.0), GOAL, None), Plan)


def _raise_recovery_error() -> Twist2D:
    raise RecoveryError("blocked")
