"""Contract of recovery behaviors: run against every registered one, including those of third parties."""

from __future__ import annotations

import pytest

from navstack.core import Pose2D, Twist2D
from navstack.move_base import GoalHandle, GoalStatus, Mode
from navstack.plugins import RECOVERY_BEHAVIORS, RecoveryBehavior
from tests.move_base.world import Bench, StraightPlanner, occupied

ENTRIES = list(RECOVERY_BEHAVIORS)
BUILT_IN = {
    "clear_costmap_recovery": "clear_costmap_recovery/ClearCostmapRecovery",
    "rotate_recovery": "rotate_recovery/RotateRecovery",
    "move_slow_and_clear": "move_slow_and_clear/MoveSlowAndClear",
    "assisted_teleop": "nav2_behaviors/AssistedTeleop",
    "back_up": "nav2_behaviors/BackUp",
    "drive_on_heading": "nav2_behaviors/DriveOnHeading",
    "spin": "nav2_behaviors/Spin",
    "wait": "nav2_behaviors/Wait",
}


def make(cls: type[RecoveryBehavior], name: str = "under_test") -> RecoveryBehavior:
    return cls(name, cls.Params())


def test_ros_names_of_the_built_in_behaviors() -> None:
    for name, alias in BUILT_IN.items():
        assert RECOVERY_BEHAVIORS.get(name).cls is RECOVERY_BEHAVIORS.get(alias).cls
        assert RECOVERY_BEHAVIORS.get(alias.replace("/", "::")).name == name


@pytest.fixture(params=ENTRIES, ids=lambda e: e.name)
def cls(request: pytest.FixtureRequest) -> type[RecoveryBehavior]:
    return request.param.cls


def test_move_base_runs_it_and_can_cancel_it(cls: type[RecoveryBehavior]) -> None:
    bench = Bench(planner=StraightPlanner(occupied), recoveries=[make(cls)])
    handle = bench.run(bench.move_base.send_goal(Pose2D(2.0, 1.0)))
    assert (handle.status, handle.result.recovery_names) == (GoalStatus.ABORTED, ("under_test",))
    assert bench.robot.twist == Twist2D()
    bench = Bench(planner=StraightPlanner(occupied), recoveries=[make(cls)])
    handle = bench.move_base.send_goal(Pose2D(2.0, 1.0))
    bench.run_to(5.3)
    running = bench.move_base.state is Mode.CLEARING
    bench.move_base.cancel_goal(handle)
    bench.run(handle)
    assert handle.status is GoalStatus.PREEMPTED
    assert bench.robot.time <= 5.5
    assert (bench.robot.twist, bench.move_base.recovery) == (Twist2D(), None), running


@pytest.mark.slow
def test_a_cancel_takes_effect_within_a_control_cycle(cls: type[RecoveryBehavior]) -> None:
    period = 0.2

    def scene_until(count: int) -> tuple[Bench, GoalHandle]:
        bench = Bench(planner=StraightPlanner(occupied), recoveries=[make(cls)], planner_patience=0.4)
        handle = bench.move_base.send_goal(Pose2D(2.0, 1.0))
        for _ in range(count):
            bench.tick()
        return bench, handle

    # the ticks at which the recovery runs
    bench, handle = scene_until(0)
    running: list[int] = []
    for count in range(1, 2000):
        bench.tick()
        if bench.move_base.recovery is not None:
            running.append(count)
        if handle.is_done:
            break
    assert handle.is_done
    for count in running[:: max(1, len(running) // 15)]:
        bench, handle = scene_until(count)
        assert bench.move_base.recovery == "under_test"
        asked = bench.robot.time
        bench.move_base.cancel_goal(handle)
        bench.run(handle)
        assert handle.status is GoalStatus.PREEMPTED
        assert bench.robot.time <= asked + period + 1e-6
        assert bench.robot.twist == Twist2D()
        assert bench.move_base.state is Mode.IDLE
