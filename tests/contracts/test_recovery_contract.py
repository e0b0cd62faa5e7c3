"""Contract of recovery behaviors: run against every registered one, including those of third parties."""

from __future__ import annotations

import math

import pytest

from navstack.core import Pose2D, RobotState, Twist2D
from navstack.core.errors import NavError
from navstack.core.parameters import ParamModel
from navstack.interfaces import RecoveryBehavior, RecoveryContext, RecoveryStatus, RecoveryStep
from navstack.move_base import GoalHandle, GoalStatus, Mode
from navstack.plugins import RECOVERY_BEHAVIORS
from tests.move_base.world import Bench, EmptyCostmap, KinematicRobot, StraightPlanner, TurnAndGo, occupied

ENTRIES = list(RECOVERY_BEHAVIORS)
BUILT_IN = {
    "clear_costmap_recovery": "clear_costmap_recovery/ClearCostmapRecovery",
    "rotate_recovery": "rotate_recovery/RotateRecovery",
    "move_slow_and_clear": "move_slow_and_clear/MoveSlowAndClear",
    "back_up": "nav2_behaviors/BackUp",
    "drive_on_heading": "nav2_behaviors/DriveOnHeading",
    "spin": "nav2_behaviors/Spin",
    "wait": "nav2_behaviors/Wait",
}


def make(cls: type[RecoveryBehavior], name: str = "under_test") -> RecoveryBehavior:
    return cls(name, cls.Params())


def scene() -> tuple[KinematicRobot, RecoveryContext]:
    robot = KinematicRobot(Pose2D(0.5, -0.5, 1.0))
    context = RecoveryContext(
        EmptyCostmap("global_costmap", "map", robot), EmptyCostmap("local_costmap", "odom", robot), TurnAndGo(), 5.0
    )
    return robot, context


def test_ros_names_of_the_built_in_behaviors() -> None:
    for name, alias in BUILT_IN.items():
        assert RECOVERY_BEHAVIORS.get(name).cls is RECOVERY_BEHAVIORS.get(alias).cls
        assert RECOVERY_BEHAVIORS.get(alias.replace("/", "::")).name == name


@pytest.fixture(params=ENTRIES, ids=lambda e: e.name)
def cls(request: pytest.FixtureRequest) -> type[RecoveryBehavior]:
    return request.param.cls


def run(recovery: RecoveryBehavior, robot: KinematicRobot, context: RecoveryContext) -> list[RecoveryStep]:
    """Step the behavior at its frequency until it ends, at most two minutes."""
    recovery.start(context, robot.time)
    frequency = recovery.frequency or context.controller_frequency
    begun = robot.time
    steps: list[RecoveryStep] = []
    while True:
        steps.append(recovery.step(RobotState(robot.odom_pose, robot.twist, robot.time, "odom"), robot.time))
        robot.command(steps[-1].twist)
        if steps[-1].status is not RecoveryStatus.RUNNING:
            return steps
        robot.advance_to(begun + len(steps) / frequency)
        assert robot.time < begun + 120.0


def test_parameters_have_defaults_and_descriptions(cls: type[RecoveryBehavior]) -> None:
    assert issubclass(cls.Params, ParamModel)
    cls.Params()
    for name, field in cls.Params.model_fields.items():
        assert field.description, name
    assert cls.__doc__


def test_it_ends_with_a_text_and_finite_commands(cls: type[RecoveryBehavior]) -> None:
    robot, context = scene()
    recovery = make(cls)
    recovery.check(context)
    steps = run(recovery, robot, context)
    assert steps[-1].status is RecoveryStatus.DONE
    assert any(step.text for step in steps)
    limits = context.local_planner.limits
    for step in steps:
        assert isinstance(step.twist, Twist2D)
        assert all(math.isfinite(v) for v in step.twist)
        assert abs(step.twist.wz) <= limits.max_vel_theta + 1e-9
        assert step.twist.speed <= limits.max_vel_trans + 1e-9
    assert steps[-1].twist == Twist2D()


def test_a_second_run_is_identical(cls: type[RecoveryBehavior]) -> None:
    recovery = make(cls)
    robot, context = scene()
    once = run(recovery, robot, context)
    robot, context = scene()
    again = run(recovery, robot, context)
    assert [(s.status, s.twist, s.text) for s in once] == [(s.status, s.twist, s.text) for s in again]


def test_it_can_be_abandoned_and_restarted_at_any_step(cls: type[RecoveryBehavior]) -> None:
    recovery = make(cls)
    robot, context = scene()
    recovery.start(context, 0.0)
    recovery.step(RobotState(robot.odom_pose), 0.0)
    robot, context = scene()
    assert run(recovery, robot, context)[-1].status is RecoveryStatus.DONE


def test_its_follow_up_ends(cls: type[RecoveryBehavior]) -> None:
    recovery = make(cls)
    robot, context = scene()
    run(recovery, robot, context)
    pose = robot.odom_pose
    left = [recovery.follow_up(RobotState(Pose2D(pose.x + 0.1 * k, pose.y)), 0.2 * k) for k in range(1000)]
    assert not left[-1]


def test_only_nav_errors_without_a_robot_pose(cls: type[RecoveryBehavior]) -> None:
    robot, context = scene()
    robot.frames.remove("base_link")
    recovery = make(cls)
    try:
        recovery.start(context, 0.0)
        recovery.step(RobotState(robot.odom_pose), 0.0)
    except NavError as exc:
        assert exc.message


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
