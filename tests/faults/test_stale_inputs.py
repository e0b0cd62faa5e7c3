"""Transforms that are lost and odometry that is impossible: the robot stops, and the goal ends with the reason."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from navstack.core import InputError, Pose2D, RobotState, Transform2D, Twist2D
from navstack.move_base import GoalHandle, GoalStatus
from navstack.move_base.control import FASTEST, SETTLE_S, OdometryCheck
from navstack.move_base.errors import OdometryError
from tests.move_base.world import LIMITS, Bench, TurnAndGo

FAR = Pose2D(4.5, 0.0, 0.0)
LOST_AT = 2.0
PATIENCE = 3.0


def publish(bench: Bench, parent: str, child: str, until: Callable[[float], bool]) -> None:
    """Publish the transform parent -> child of every later step of the robot while `until` is false."""
    robot = bench.robot
    publish_odometry = robot._publish  # pyright: ignore[reportPrivateUsage]

    def both() -> None:
        publish_odometry()
        if not until(robot.time):
            robot.frames.set(parent, child, Transform2D(), robot.time)

    robot._publish = both  # type: ignore[method-assign]  # pyright: ignore[reportPrivateUsage]
    both()


def run(bench: Bench, goal: Pose2D = FAR) -> GoalHandle:
    return bench.run(bench.move_base.send_goal(goal))


def last_motion(bench: Bench) -> float:
    """Time (s) of the last command that is not zero."""
    return max(t for t, twist in bench.robot.commands if twist != Twist2D())


@pytest.mark.parametrize("lost", ["map->odom", "odom->base_link"])
def test_a_lost_transform_stops_the_robot_and_ends_the_goal(lost: str) -> None:
    bench = Bench()
    if lost == "map->odom":
        publish(bench, "map", "odom", lambda t: t > LOST_AT)
    else:
        bench.robot.deaf_since = LOST_AT
    handle = run(bench)
    assert (handle.status, handle.result.error_name) == (GoalStatus.ABORTED, "TF_ERROR")
    parent, _, child = lost.partition("->")
    assert f'the pose of "{child}" in "{parent}"' in handle.result.message
    # transform_tolerance of 0.3 s, and one period of the control cycle
    assert last_motion(bench) <= LOST_AT + 0.3 + 0.2 + 1e-6
    if lost == "map->odom":
        assert handle.result.ended_at == pytest.approx(LOST_AT + 0.3 + PATIENCE, abs=0.45)
        assert any(e.text.startswith("the robot is stopped") for e in bench.listener.of("warning"))


def test_a_transform_that_returns_is_used_again() -> None:
    bench = Bench()
    publish(bench, "map", "odom", lambda t: LOST_AT < t < LOST_AT + 2.0)
    handle = run(bench)
    assert handle.status is GoalStatus.SUCCEEDED
    stopped = [t for t, twist in bench.robot.commands if twist == Twist2D() and LOST_AT < t < LOST_AT + 2.0]
    assert stopped
    (warning,) = [e for e in bench.listener.of("warning") if e.text.startswith("the robot is stopped")]
    assert '"odom" in "map"' in warning.text


def test_a_goal_in_a_lost_frame_has_no_plan() -> None:
    bench = Bench()
    bench.robot.frames.set("map", "dock", Transform2D(), 0.0)
    bench.run_to(2.0)
    handle = bench.run(bench.move_base.send_goal(Pose2D(1.0, 0.0, 0.0), "dock"))
    assert (handle.status, handle.result.error_name) == (GoalStatus.ABORTED, "TF_ERROR")
    assert '"dock"' in handle.result.message
    assert bench.robot.odom_pose == Pose2D(0.0, 0.0, 0.0)


# --- odometry ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "velocity", [Twist2D(1e30, 0.0, 0.0), Twist2D(0.0, -20.0, 0.0), Twist2D(0.3, 0.0, 1e9), Twist2D(-1e300, 1e300, 0.0)]
)
def test_an_impossible_velocity_stops_the_robot_and_ends_the_goal(velocity: Twist2D) -> None:
    bench = Bench()
    state = bench.robot.state
    bench.robot.state = lambda: state()._replace(velocity=velocity) if bench.robot.time > LOST_AT else state()  # type: ignore[method-assign]
    handle = run(bench)
    assert (handle.status, handle.result.error_name) == (GoalStatus.ABORTED, "IMPOSSIBLE_ODOMETRY")
    assert "far beyond the limits" in handle.result.message
    assert last_motion(bench) <= LOST_AT + 1e-6
    assert handle.result.ended_at == pytest.approx(LOST_AT + PATIENCE, abs=0.45)


@pytest.mark.parametrize("what", ["message", "transform"])
@pytest.mark.parametrize("jump", [Pose2D(30.0, 0.0, 0.0), Pose2D(0.0, 0.0, 2.5), Pose2D(math.inf, 0.0, 0.0)])
def test_poses_that_keep_jumping_end_the_goal(what: str, jump: Pose2D) -> None:
    if what == "transform" and math.isinf(jump.x):
        jump = Pose2D(1e12, 0.0, 0.0)
    bench = Bench()
    robot = bench.robot
    state = robot.state
    calls = 0

    def jumping() -> RobotState:
        nonlocal calls
        now = state()
        calls += 1
        if robot.time < LOST_AT or calls % 2:
            return now
        pose = now.pose
        return now._replace(pose=Pose2D(pose.x + jump.x, pose.y, pose.yaw + jump.yaw))

    def jumping_frames() -> None:
        shift = jump if robot.time >= LOST_AT and round(robot.time / 0.2) % 2 else Pose2D(0.0, 0.0)
        x, y, yaw = robot.odom_pose
        robot.frames.set("odom", "base_link", Transform2D(x + shift.x, y, yaw + shift.yaw), robot.time)

    if what == "message":
        robot.state = jumping  # type: ignore[method-assign]
        bench.local_costmap.frame = "map"
    else:
        robot._publish = jumping_frames  # type: ignore[method-assign]  # pyright: ignore[reportPrivateUsage]
    handle = run(bench)
    assert (handle.status, handle.result.error_name) == (GoalStatus.ABORTED, "IMPOSSIBLE_ODOMETRY")
    assert "jumped by" in handle.result.message
    assert last_motion(bench) <= LOST_AT + 0.4
    assert handle.result.ended_at == pytest.approx(LOST_AT + PATIENCE, abs=0.65)


@pytest.mark.parametrize("stamp", ["kept", "nan"])
def test_odometry_that_stops_stops_the_robot_and_ends_the_goal(stamp: str) -> None:
    """The transforms go on, so only the stamp of the velocity shows it."""
    bench = Bench()
    state = bench.robot.state
    old: list[RobotState] = []

    def stuck() -> RobotState:
        if bench.robot.time <= LOST_AT:
            return state()._replace(stamp=bench.robot.time)
        old.append(state()._replace(stamp=math.nan if stamp == "nan" else LOST_AT))
        return old[0]

    bench.robot.state = stuck  # type: ignore[method-assign]
    handle = run(bench)
    assert (handle.status, handle.result.error_name) == (GoalStatus.ABORTED, "ODOMETRY_STALE")
    assert "transform_tolerance = 0.3 s" in handle.result.message
    tolerance = 0.3 if stamp == "kept" else 0.0
    assert last_motion(bench) <= LOST_AT + tolerance + 0.2 + 1e-6
    assert handle.result.ended_at == pytest.approx(LOST_AT + tolerance + PATIENCE, abs=0.45)


def test_odometry_that_returns_is_used_again() -> None:
    bench = Bench()
    state = bench.robot.state

    def late() -> RobotState:
        now = bench.robot.time
        return state()._replace(stamp=LOST_AT if LOST_AT < now < LOST_AT + 2.0 else now)

    bench.robot.state = late  # type: ignore[method-assign]
    assert run(bench).status is GoalStatus.SUCCEEDED
    assert [t for t, twist in bench.robot.commands if twist == Twist2D() and LOST_AT < t < LOST_AT + 2.0]


def test_odometry_without_a_stamp_counts_as_new() -> None:
    bench = Bench()
    state = bench.robot.state
    bench.robot.state = lambda: state()._replace(stamp=0.0)  # type: ignore[method-assign]
    assert run(bench).status is GoalStatus.SUCCEEDED


def test_the_robot_drives_on_after_a_single_jump() -> None:
    bench = Bench()
    robot = bench.robot
    state = robot.state
    robot.state = lambda: state()._replace(pose=Pose2D(9.0, 0.0)) if robot.time > LOST_AT else state()  # type: ignore[method-assign]
    bench.local_costmap.frame = "map"
    handle = run(bench)
    assert handle.status is GoalStatus.SUCCEEDED
    stopped = [t for t, twist in robot.commands if twist == Twist2D() and t < 4.0 and t > LOST_AT]
    assert stopped[-1] - stopped[0] == pytest.approx(SETTLE_S, abs=0.21)


def state_at(x: float = 0.0, yaw: float = 0.0, vx: float = 0.0) -> RobotState:
    return RobotState(Pose2D(x, 0.0, yaw), Twist2D(vx, 0.0, 0.0))


def test_what_a_robot_can_do_is_possible() -> None:
    check, planner = OdometryCheck(), TurnAndGo()
    # three times the limit of 0.5 m/s plus 1 m/s: downhill, pushed or driven by another node
    for k in range(50):
        check.check(state_at(0.2 * 2.5 * k, math.remainder(6.0 * 0.2 * k, math.tau), 2.5), planner, 0.2 * k)
    with pytest.raises(OdometryError):
        check.check(state_at(0.2 * 2.5 * 49, 0.0, 2.6), planner, 9.8)


def test_limits_that_are_lowered_for_a_while_do_not_count() -> None:
    check, planner = OdometryCheck(), TurnAndGo()
    check.check(state_at(vx=2.4), planner, 0.0)
    planner._limits = LIMITS._replace(max_vel_x=0.1, max_vel_trans=0.1)  # pyright: ignore[reportPrivateUsage]
    check.check(state_at(vx=2.4), planner, 0.1)


@pytest.mark.parametrize("limit", [math.inf, 1e30])
def test_a_planner_without_limits(limit: float) -> None:
    check, planner = OdometryCheck(), TurnAndGo(limits=LIMITS._replace(max_vel_trans=limit, max_vel_theta=limit))
    check.check(state_at(vx=FASTEST - 1.0), planner, 0.0)
    with pytest.raises(OdometryError):
        check.check(state_at(vx=FASTEST + 1.0), planner, 0.1)


def test_a_robot_that_was_carried_between_two_goals_has_not_jumped() -> None:
    bench = Bench()
    assert run(bench, Pose2D(1.0, 0.0, 0.0)).status is GoalStatus.SUCCEEDED
    bench.run_to(bench.robot.time + 2.0)
    bench.robot.odom_pose = Pose2D(-3.0, 2.0, 1.0)
    bench.run_to(bench.robot.time + 2.0)
    assert run(bench, Pose2D(1.0, 0.0, 0.0)).status is GoalStatus.SUCCEEDED
    assert not [e for e in bench.listener.of("warning") if "odometry" in e.text]


def test_impossible_odometry_is_an_error_of_the_state() -> None:
    bench = Bench()
    bench.robot.state = lambda: state_at(vx=1e6)  # type: ignore[method-assign]
    bench.tick()
    with pytest.raises(OdometryError, match="far beyond the limits"):
        bench.move_base.local_state(bench.robot.time)
    assert not issubclass(OdometryError, InputError)
