"""move, turn, drive to a pose and wait: distances, angles, limits, obstacles."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from navstack.behaviors import (
    DriveToPose,
    FollowTrajectory,
    InvalidMotionError,
    MotionCollisionError,
    MotionTimeoutError,
    Move,
    Pause,
    Trajectory,
    Turn,
)
from navstack.core import NavError, Pose2D, Transform2D, angle_between
from navstack.parameters import MotionParams
from navstack.plugins import Behavior, BehaviorStatus, VelocityLimits
from tests.behaviors.stage import MOVING, START, Planner, Stage

RATES = (5.0, 20.0, 50.0)


def params(**values: Any) -> MotionParams:
    return MotionParams(**values)


def along(pose: Pose2D) -> Pose2D:
    """A pose seen from the start."""
    return Transform2D(*START).inverse().apply(pose)


def turned(stage: Stage) -> float:
    """The true angle turned, counted beyond full turns."""
    yaws = [START.yaw, *(pose.yaw for pose in stage.poses), stage.robot.pose.yaw]
    return sum(angle_between(a, b) for a, b in itertools.pairwise(yaws))


def assert_within_limits(stage: Stage, rate: float) -> None:
    """Commands change by at most the acceleration of one cycle; the first starts from rest."""
    commands = np.concatenate((np.zeros((1, 3)), stage.commands[:-1]))
    change = np.abs(np.diff(commands, axis=0)).max(axis=0)
    assert change[0] <= 1.0 / rate + 1e-9
    assert change[2] <= 2.0 / rate + 1e-9
    assert np.abs(stage.commands[:, 0]).max() <= 0.5 + 1e-9


# --- distances --------------------------------------------------------------------------------------------------------


@pytest.mark.sampled
@pytest.mark.slow
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("base", [{}, MOVING], ids=["ideal", "accelerating"])
@pytest.mark.parametrize("distance", [0.05, 0.5, -0.5, -2.0])
def test_move_ends_within_the_tolerance_and_one_cycle(distance: float, base: dict[str, Any], rate: float) -> None:
    p = params(frequency=rate, speed_linear=0.4)
    stage = Stage(Move(distance, p), **base)
    assert stage.run().status is BehaviorStatus.DONE
    end = along(stage.robot.pose)
    # within the tolerance and the travel of one cycle at the speed from which the robot can stop in a cycle
    assert end.x == pytest.approx(distance, abs=p.tolerance + 1.0 / rate**2)
    assert abs(end.x - distance) <= p.tolerance + 1e-9 or rate == 5.0
    assert abs(end.y) < 1e-3
    assert_within_limits(stage, rate)


@pytest.mark.parametrize("rate", RATES)
def test_move_takes_the_time_of_the_trapezoid(rate: float) -> None:
    """d / v + v / a, and at most a few cycles and the slow end more."""
    stage = Stage(Move(2.0, params(frequency=rate, speed_linear=0.4)), **MOVING)
    stage.run()
    assert 2.0 / 0.4 + 0.4 / 1.0 - 0.05 < stage.times[-1] < 2.0 / 0.4 + 0.4 / 1.0 + 4.0 / rate + 0.6


def test_move_in_the_map_corrects_what_the_odometry_gets_wrong() -> None:
    """Odometry that reports 5 % too much, turning by 0.05 rad/m: in odom the robot ends there, in the map at the target."""
    drift: dict[str, Any] = {"odometry_scale": 0.05, "odometry_turn": 0.05}
    by_odometry, by_map = Stage(Move(2.0, params()), **drift), Stage(Move(2.0, params(frame="map")), **drift)
    by_odometry.run()
    by_map.run()
    assert along(by_odometry.robot.pose).x == pytest.approx(2.0 / 1.05, abs=0.02)
    assert abs(along(by_odometry.robot.pose).y) > 0.05
    assert along(by_map.robot.pose).x == pytest.approx(2.0, abs=0.011)
    assert abs(along(by_map.robot.pose).y) < 0.01


def test_a_robot_that_is_pushed_over_the_target_drives_back() -> None:
    stage = Stage(Move(0.5, params()))
    motion, robot = stage.motion, stage.robot
    motion.start(stage.context, 0.0)
    state = robot.state()
    motion.step(state, 0.0)
    beyond = Transform2D(*state.pose).apply(Pose2D(0.7, 0.0))
    for k in range(1, 4):
        step = motion.step(state.__class__(beyond, state.velocity, 0.05 * k, state.frame), 0.05 * k)
    assert step.status is BehaviorStatus.RUNNING
    assert step.twist.vx < 0.0


# --- turns ------------------------------------------------------------------------------------------------------------


@pytest.mark.sampled
@pytest.mark.slow
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("base", [{}, MOVING], ids=["ideal", "accelerating"])
@pytest.mark.parametrize("degrees", [10, -10, -90, 180, 270, 1000, -1000])
def test_turns_end_within_the_tolerance(degrees: float, base: dict[str, Any], rate: float) -> None:
    p = params(frequency=rate, speed_radian=1.5, disable_collision_checks=True)
    stage = Stage(Turn(math.radians(degrees), p), **base)
    assert stage.run().status is BehaviorStatus.DONE
    assert turned(stage) == pytest.approx(math.radians(degrees), abs=p.tolerance_radian)
    assert stage.robot.pose.distance_to(START) < 1e-9
    assert_within_limits(stage, rate)


@pytest.mark.parametrize(
    ("degrees", "shorter"), [(270.0, -90.0), (-270.0, 90.0), (360.0, 0.0), (190.0, -170.0), (-45.0, -45.0)]
)
def test_the_shortest_turn_to_a_heading(degrees: float, shorter: float) -> None:
    stage = Stage(Turn(math.radians(degrees), params(), shortest=True))
    stage.run()
    assert turned(stage) == pytest.approx(math.radians(shorter), abs=0.02)


def test_a_turn_that_starts_near_the_wrap_of_the_heading_ends() -> None:
    """The defect of the tutorial's node: a target near 0 or 2 pi."""
    stage = Stage(Turn(0.02 + math.pi, params()), start=Pose2D(0.0, 0.0, math.pi - 0.01))
    assert stage.run().status is BehaviorStatus.DONE


# --- drive to a pose --------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.parametrize("base", [{}, MOVING], ids=["ideal", "accelerating"])
def test_drive_to_pose_ends_at_the_pose(base: dict[str, Any], backwards: bool, rate: float) -> None:
    goal = Pose2D(-1.2, 0.9, 2.9)
    p = params(frequency=rate, speed_linear=0.4)
    stage = Stage(DriveToPose(goal, p, backwards=backwards), **base)
    assert stage.run().status is BehaviorStatus.DONE
    end = stage.robot.pose
    # the turn towards the line ends within its tolerance, and the robot is steered back to the line
    assert end.distance_to(goal) < p.tolerance + 1.0 / rate**2 + 0.01
    assert abs(angle_between(end.yaw, goal.yaw)) <= p.tolerance_radian + 1e-9
    signs = stage.commands[np.abs(stage.commands[:, 0]) > 0.2, 0]
    assert (signs < 0.0).all() if backwards else (signs > 0.0).all()
    assert_within_limits(stage, rate)


def test_drive_to_the_pose_of_the_robot_turns_only() -> None:
    stage = Stage(DriveToPose(Pose2D(START.x, START.y, START.yaw + 1.0), params()))
    stage.run()
    assert stage.robot.pose.distance_to(START) < 1e-9
    assert turned(stage) == pytest.approx(1.0, abs=0.02)


def test_wait_stands_still() -> None:
    stage = Stage(Pause(2.0))
    assert stage.run().status is BehaviorStatus.DONE
    assert stage.times[-1] == pytest.approx(2.0)
    assert not stage.commands.any()


# --- obstacles, limits, wrong input -----------------------------------------------------------------------------------


@pytest.mark.parametrize("known", [False, True], ids=["seen", "known"])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_move_stops_before_an_obstacle_that_appears(sign: float, known: bool) -> None:
    """A wall 1.2 m away, seen after 1 s of driving: the robot brakes within its limits, and never touches it."""
    stage = Stage(Move(sign * 2.0, params(speed_linear=0.5)), start=Pose2D(0.0, 0.0), **MOVING)
    motion, robot = stage.motion, stage.robot
    motion.start(stage.context, 0.0)
    commands = []
    with pytest.raises(
        MotionCollisionError, match=r"stopped: the footprint hits an obstacle of the (local|global)_costmap"
    ) as error:
        for k in range(200):
            robot.advance_to(0.05 * k)
            if k == 20:
                stage.wall(sign * 1.2, 0.0, known=known)
            step = motion.step(robot.state(), robot.time)
            commands.append(step.twist.vx)
            robot.command(step.twist)
    assert abs(robot.pose.x) < 1.2 - 0.18 - 0.025
    assert np.abs(np.diff(commands)).max() <= 1.0 * 0.05 + 1e-9
    assert abs(commands[-1]) <= 0.05
    assert error.value.data["collision_after_m"] > 0.0


def test_an_obstacle_within_the_braking_distance_stops_at_once() -> None:
    stage = Stage(Move(2.0, params(speed_linear=0.5)), start=Pose2D(0.0, 0.0), **MOVING)
    motion, robot = stage.motion, stage.robot
    motion.start(stage.context, 0.0)
    with pytest.raises(MotionCollisionError):
        for k in range(200):
            robot.advance_to(0.05 * k)
            if k == 40:
                stage.wall(robot.pose.x + 0.18 + 0.1, 0.0)
            step = motion.step(robot.state(), robot.time)
            robot.command(step.twist)
    assert k == 40


def test_a_motion_into_a_known_wall_does_not_start() -> None:
    stage = Stage(Move(3.0, params()), start=Pose2D(0.0, 0.0))
    stage.wall(2.5, 0.0, known=True)
    with pytest.raises(MotionCollisionError, match=r"move did not start: .+ after another 2\.3. m"):
        stage.run()
    turning = Stage(DriveToPose(Pose2D(2.0, 2.0, 0.0), params()), start=Pose2D(0.0, 0.0))
    turning.wall(1.0, 1.0, known=True)
    with pytest.raises(MotionCollisionError, match="did not start"):
        turning.run()
    unchecked = Stage(Move(3.0, params(disable_collision_checks=True)), start=Pose2D(0.0, 0.0))
    unchecked.wall(2.5, 0.0, known=True)
    assert unchecked.run().status is BehaviorStatus.DONE


@pytest.mark.parametrize("known", [False, True])
def test_a_motion_leaves_what_the_footprint_overlaps(known: bool) -> None:
    """A mark under the edge ahead: the robot drives away from it, and not over it."""
    away, over = (Stage(Move(distance, params()), start=Pose2D(0.0, 0.0, 0.0)) for distance in (-0.3, 0.3))
    for stage in (away, over):
        stage.wall(0.16, 0.0, known=known)
    assert away.run().status is BehaviorStatus.DONE
    assert away.robot.pose.x == pytest.approx(-0.3, abs=0.02)
    with pytest.raises(MotionCollisionError):
        over.run()
    assert over.robot.pose.x == 0.0


def test_a_robot_that_does_not_move_times_out() -> None:
    stage = Stage(Move(1.0, params(time_allowance=3.0)), velocity_lag=1e3)
    with pytest.raises(MotionTimeoutError, match=r"move: drove 0\.00. of 1\.000 m within its time allowance of 3\.0 s"):
        stage.run()
    assert stage.times[-1] <= 3.1


@pytest.mark.parametrize(
    "make",
    [
        lambda: Move(math.nan),
        lambda: Turn(math.inf),
        lambda: DriveToPose(Pose2D(math.nan, 0.0)),
        lambda: Pause(-1.0),
    ],
)
def test_wrong_arguments_are_refused(make: Any) -> None:
    with pytest.raises(InvalidMotionError):
        make()


def test_a_motion_can_start_again() -> None:
    motion: Behavior = Move(0.5, params())
    for _ in range(2):
        stage = Stage(motion)
        stage.run()
        assert along(stage.robot.pose).x == pytest.approx(0.5, abs=0.011)
    with pytest.raises(NavError):
        raise MotionTimeoutError("it has a code")


# --- bases with a turning radius ----------------------------------------------------------------------------------------


class CarPlanner(Planner):
    """The same with a turning radius."""

    @property
    def limits(self) -> VelocityLimits:
        return super().limits._replace(min_turning_radius=0.85)


def test_what_turns_in_place_refuses_a_car_and_the_rest_drives() -> None:
    """The turning radius is that of the local planner, also for motions from Python."""
    for motion in (Turn(1.0, params()), DriveToPose(Pose2D(1.0, 1.0), params())):
        stage = Stage(motion)
        stage.context = replace(stage.context, local_planner=CarPlanner())
        with pytest.raises(InvalidMotionError, match=r"turning radius of 0\.85 m cannot turn in place; send a goal"):
            stage.run()
    stage = Stage(Move(-1.0, params()))
    stage.context = replace(stage.context, local_planner=CarPlanner())
    assert stage.run().status is BehaviorStatus.DONE


def test_a_trajectory_beside_the_heading_of_a_car_is_refused() -> None:
    beside = Trajectory(
        np.array([0.0, 10.0]),
        np.array([[START.x, START.y, 0.0], [START.x, START.y + 2.0, 0.0]]),
        np.tile([0.0, 0.2, 0.0], (2, 1)),
        np.zeros((2, 3)),
    )
    stage = Stage(FollowTrajectory(beside, params(), fit=True))
    stage.context = replace(stage.context, local_planner=CarPlanner())
    with pytest.raises(InvalidMotionError, match=r"begins 49\.9 degrees from the robot's heading"):
        stage.run()
