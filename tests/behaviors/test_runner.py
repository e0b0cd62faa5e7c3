"""The one runner: every way out of a behavior is an end with a status, a text and an error."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, cast

import pytest

from navstack.behaviors import BehaviorRunner, Spin, SpinParams, Wait, WaitParams
from navstack.core import FrameError, InternalError, NavError, ParameterError, Pose2D, RobotState, Twist2D
from navstack.move_base import GoalStatus, Schedule, plugin_calls
from navstack.plugins import (
    Behavior,
    BehaviorContext,
    BehaviorStatus,
    BehaviorStep,
    RecoveryBehavior,
    RecoveryContext,
    RecoveryStatus,
    RecoveryStep,
)
from tests.move_base.world import Bench

STATE = RobotState(Pose2D(0.0, 0.0))
CONTEXT = Bench().move_base.recovery_context


class Scripted(Behavior[None]):
    """Returns what `act` returns."""

    def __init__(self, act: Callable[[float], Any]) -> None:
        super().__init__("scripted", None)
        self.act = act

    def start(self, context: BehaviorContext, now: float) -> None:
        """Nothing to prepare."""

    def step(self, state: RobotState, now: float) -> BehaviorStep:
        """Return the scripted step."""
        return self.act(now)


def started(act: Callable[[float], Any]) -> BehaviorRunner:
    runner = BehaviorRunner(Schedule, plugin_calls.call)
    assert runner.start(Scripted(act), CONTEXT, 1.0, 5.0) is None
    return runner


def test_steps_are_due_at_the_behaviors_rate_or_the_default() -> None:
    runner = started(lambda now: BehaviorStep(BehaviorStatus.RUNNING, Twist2D(0.1, 0.0, 0.0)))
    assert runner.due == 1.0 and runner.is_due(1.0) and not runner.is_due(0.9)
    runner.advance(1.0)
    assert runner.due == pytest.approx(1.2)
    assert runner.step(lambda now: STATE, 1.2) == BehaviorStep(BehaviorStatus.RUNNING, Twist2D(0.1, 0.0, 0.0))
    runner.drop(1.3)
    assert runner.running is None and runner.due == math.inf and not runner.is_due(2.0)
    spin = BehaviorRunner(Schedule)
    bench = Bench()
    assert spin.start(Spin("it", SpinParams(cycle_frequency=8.0)), bench.move_base.recovery_context, 0.0, 5.0) is None
    spin.advance(0.0)
    assert spin.due == 0.125


def test_without_move_base_a_motion_has_its_own_limits_only() -> None:
    """As the nodes linear_move and radian_turn, which have no local planner."""
    runner = BehaviorRunner(Schedule, plugin_calls.call)
    fast = BehaviorStep(BehaviorStatus.RUNNING, Twist2D(3.0, 0.0, 0.0))
    assert runner.start(Scripted(lambda now: fast), cast("BehaviorContext", None), 1.0, 5.0) is None
    assert runner.step(lambda now: STATE, 1.0) == fast


def test_what_a_behavior_says_at_its_end() -> None:
    done = started(lambda now: BehaviorStep(BehaviorStatus.DONE, text="it is done", data={"left_m": 0.5}))
    end = done.step(lambda now: STATE, 1.0)
    assert not isinstance(end, BehaviorStep)
    assert (end.status, end.text, end.data, end.error) == (BehaviorStatus.DONE, "it is done", {"left_m": 0.5}, None)
    failed = started(lambda now: BehaviorStep(BehaviorStatus.FAILED, data={"left_m": 0.5}))
    end = failed.step(lambda now: STATE, 1.0)
    assert not isinstance(end, BehaviorStep)
    assert end.status is BehaviorStatus.FAILED
    assert end.error is not None and end.error.message == "scripted failed"
    assert end.error.data == {"recovery": "scripted", "left_m": 0.5}


@pytest.mark.parametrize(
    ("result", "kind", "message"),
    [
        (ValueError("no"), InternalError, "scripted raised ValueError: no"),
        (NavError("no way"), NavError, "no way"),
        (None, InternalError, "scripted returned a NoneType, not a BehaviorStep"),
        (BehaviorStep(BehaviorStatus.RUNNING, Twist2D(math.nan, 0.0, 0.0)), InternalError, "three finite numbers"),
        (BehaviorStep(BehaviorStatus.RUNNING, cast("Twist2D", (0.1, 0.0, 0.0))), InternalError, "not a Twist2D"),
        (BehaviorStep(BehaviorStatus.RUNNING, Twist2D(cast("float", "fast"), 0.0, 0.0)), InternalError, "commands"),
    ],
)
def test_whatever_a_plugin_raises_or_returns_is_an_end(result: Any, kind: type[NavError], message: str) -> None:
    def act(now: float) -> Any:
        if isinstance(result, Exception):
            raise result
        return result

    end = started(act).step(lambda now: STATE, 1.0)
    assert not isinstance(end, BehaviorStep)
    assert end.status is BehaviorStatus.FAILED and end.step is None
    assert isinstance(end.error, kind) and message in end.error.message
    assert end.text == end.error.message
    assert end.data["code"] == end.error.code


def test_an_unknown_pose_and_a_start_that_fails_are_ends_too() -> None:
    def lost(now: float) -> RobotState:
        raise FrameError("the pose is not known")

    runner = started(lambda now: BehaviorStep(BehaviorStatus.RUNNING))
    end = runner.step(lost, 1.0)
    assert not isinstance(end, BehaviorStep) and end.text == "the pose is not known"

    class Misfit(Scripted):
        def check(self, context: BehaviorContext) -> None:
            raise ParameterError("it does not fit")

    misfit = BehaviorRunner(Schedule, plugin_calls.call)
    assert misfit.start(Misfit(lambda now: None), CONTEXT, 0.0, 5.0) is None
    refused = misfit.start(Misfit(lambda now: None), CONTEXT, 0.0, 5.0, check=True)
    assert refused is not None and refused.text == "it does not fit"
    assert misfit.due == math.inf


def test_a_recovery_behavior_runs_as_a_motion() -> None:
    """They are one kind: what is started while no goal is active may be any behavior."""
    bench = Bench()
    handle = bench.move_base.motions.start(Spin("look", SpinParams(spin_dist=1.0)))
    while not handle.is_done:
        bench.tick()
    assert handle.status is GoalStatus.SUCCEEDED
    assert handle.text == "look: turned 57 degrees"
    assert bench.robot.odom_pose.yaw == pytest.approx(1.0, abs=0.03)
    waiting = bench.move_base.motions.start(Wait("rest", WaitParams(wait_duration=30.0)))
    bench.tick()
    bench.move_base.motions.cancel()
    assert waiting.status is GoalStatus.PREEMPTED


def test_plugins_keep_the_names_they_import() -> None:
    assert (RecoveryBehavior, RecoveryContext) == (Behavior, BehaviorContext)
    assert (RecoveryStatus, RecoveryStep) == (BehaviorStatus, BehaviorStep)
