"""assisted_teleop: a person drives, slower before obstacles."""

from __future__ import annotations

import math

import pytest

from navstack.behaviors import AssistedTeleop
from navstack.behaviors.assisted_teleop import HELD_S
from navstack.behaviors.errors import AssistedTeleopTimeoutError
from navstack.core import Pose2D, RobotState, Twist2D
from navstack.move_base import BusyError, GoalStatus, Mode
from navstack.plugins import BehaviorStatus, BehaviorStep
from tests.behaviors.test_nav2_behaviors import Stage
from tests.move_base.world import Bench, StraightPlanner, occupied


def started(**params: float) -> Stage:
    stage = Stage(AssistedTeleop, **params)
    stage.recovery.start(stage.context, 0.0)
    return stage


def step(stage: Stage, twist: Twist2D | None = None, now: float = 0.0) -> BehaviorStep:
    behavior = stage.recovery
    assert isinstance(behavior, AssistedTeleop)
    if twist is not None:
        behavior.take(twist, now)
    return behavior.step(RobotState(stage.robot.odom_pose, stage.robot.twist), now)


def test_in_free_space_the_command_passes_within_the_limits() -> None:
    stage = started()
    limits = stage.context.local_planner.limits
    assert step(stage).twist == Twist2D()
    assert step(stage, Twist2D(0.2, 0.0, 0.3)).twist == Twist2D(0.2, 0.0, 0.3)
    fast = step(stage, Twist2D(4.0 * limits.max_vel_trans, 0.0, 0.4)).twist
    assert fast.vx == pytest.approx(limits.max_vel_trans) and fast.wz == pytest.approx(0.1)  # the arc stays


@pytest.mark.parametrize(("along", "factor"), [(0.75, 0.9), (0.62, 0.65), (0.45, 0.3), (0.28, 0.0)])
def test_the_speed_falls_with_the_time_to_the_obstacle(along: float, factor: float) -> None:
    """The footprint's front is 0.2 to 0.25 m ahead: at 0.5 m/s it hits a wall at 0.62 m after about 0.8 s."""
    stage = started(simulation_time_step=0.05)
    stage.wall(along)
    found = step(stage, Twist2D(0.5, 0.0, 0.0))
    assert found.data["factor"] == pytest.approx(factor, abs=0.16) and found.status is BehaviorStatus.RUNNING
    assert found.twist.vx == pytest.approx(0.5 * found.data["factor"])
    assert step(stage, Twist2D(-0.3, 0.0, 0.0)).twist == Twist2D(-0.3, 0.0, 0.0)  # away from it


def test_the_factor_is_the_free_share_of_the_projection() -> None:
    """The first projected pose that collides decides: k steps of 0.1 s give k / 10; the first one stops the robot."""
    factors = []
    for tenth in range(2, 12):
        stage = started()
        stage.wall(0.1 * tenth)
        factors.append(round(step(stage, Twist2D(0.5, 0.0, 0.0)).data["factor"], 9))
    assert factors == sorted(factors) and factors[0] == 0.0 and factors[-1] == 1.0
    assert all(10.0 * factor == pytest.approx(round(10.0 * factor)) and factor != 0.1 for factor in factors)


def test_a_projection_follows_the_arc() -> None:
    behavior = AssistedTeleop("it", AssistedTeleop.Params(projection_time=1.0, simulation_time_step=0.01))
    poses = behavior.projected(Twist2D(0.5, 0.0, 1.0))
    assert len(poses) == 100
    assert poses[-1].tolist() == pytest.approx([0.5 * math.sin(1.0), 0.5 * (1.0 - math.cos(1.0)), 1.0], abs=5e-3)
    sideways = behavior.projected(Twist2D(0.0, 0.3, 0.0))
    assert sideways[-1].tolist() == pytest.approx([0.0, 0.3, 0.0])


def test_a_command_is_forgotten_after_a_while() -> None:
    stage = started()
    assert step(stage, Twist2D(0.2, 0.0, 0.0), 1.0).twist.vx == 0.2
    assert step(stage, None, 1.0 + HELD_S).twist.vx == 0.2
    assert step(stage, None, 1.1 + HELD_S).twist.vx == 0.0


def test_its_two_ends() -> None:
    stage = started(time_allowance=2.0)
    assert step(stage, None, 2.0).status is BehaviorStatus.RUNNING
    with pytest.raises(AssistedTeleopTimeoutError, match="did not end it within its time_allowance of 2 s") as caught:
        step(stage, None, 2.1)
    assert caught.value.code == 731
    stage = started()
    step(stage)
    assert isinstance(stage.recovery, AssistedTeleop)
    stage.recovery.preempt()
    assert step(stage, None, 0.1).status is BehaviorStatus.DONE


def test_the_goal_manager_gives_it_the_commands_of_the_person() -> None:
    bench = Bench(planner=StraightPlanner(occupied), recoveries=[AssistedTeleop("help", AssistedTeleop.Params())])
    handle = bench.move_base.send_goal(Pose2D(2.0, 1.0))
    bench.run_to(1.0)
    with pytest.raises(BusyError):
        bench.move_base.motions.drive(Twist2D(0.1, 0.0, 0.0))
    while bench.move_base.state is not Mode.CLEARING:
        bench.run_to(bench.robot.time + 0.1)
    bench.run_to(bench.robot.time + 0.2)
    assert bench.robot.twist == Twist2D()
    bench.move_base.motions.drive(Twist2D(0.1, 0.0, 0.2))
    bench.run_to(bench.robot.time + 0.2)
    assert bench.robot.twist == Twist2D(0.1, 0.0, 0.2)
    bench.run(handle)
    assert handle.status is GoalStatus.ABORTED and bench.robot.twist == Twist2D()
    assert handle.result.recovery_names == ("help",)
