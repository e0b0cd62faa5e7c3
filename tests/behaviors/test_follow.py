"""Following trajectories and paths: errors on closed curves, perfect and noisy; limits; failures."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest

from navstack.behaviors import (
    FollowPath,
    FollowTrajectory,
    InfeasibleTrajectoryError,
    InvalidMotionError,
    MotionCollisionError,
    TrackingLostError,
    Trajectory,
    demands_of,
    figure_eight,
    heart,
    with_rest,
)
from navstack.behaviors.follow import TrackingError, track, tracking_error
from navstack.core import Footprint, Path, Pose2D, Transform2D, angle_between
from navstack.parameters import MotionParams
from navstack.plugins import BehaviorStatus
from tests.behaviors.stage import MOVING, START, Stage

NOISY: dict[str, Any] = {
    "wheel_slip": 0.05,
    "odometry_noise": 0.05,
    "wheel_slip_turn": 0.02,
    "odometry_noise_turn": 0.02,
}


def at_speed(trajectory: Trajectory, speed: float) -> Trajectory:
    """The trajectory with this largest speed (m/s)."""
    return trajectory.slower(float(demands_of(trajectory).speed.max()) / speed)


CURVES = {
    "heart": at_speed(heart(1.0, 60.0), 0.4),
    "figure_eight": with_rest(at_speed(figure_eight(3.0, 2.0, 60.0), 0.4), 0.5),
}


def true_errors(stage: Stage, motion: FollowTrajectory) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Distance (m) of the true pose from the reference, at every step with a clock."""
    clock = motion.clock
    assert clock is not None
    rows = [(t - clock, pose) for t, pose in zip(stage.times, stage.poses) if t >= clock]
    return np.array([pose.distance_to(motion.trajectory.at(t).pose) for t, pose in rows])


def params(**values: Any) -> MotionParams:
    return MotionParams(**({"disable_collision_checks": True} | values))


@pytest.mark.slow
@pytest.mark.parametrize(("rate", "tracking"), [(5.0, "kanayama"), (20.0, "kanayama"), (20.0, "samson")])
@pytest.mark.parametrize("base", [{}, MOVING], ids=["ideal", "accelerating"])
@pytest.mark.parametrize("curve", CURVES)
def test_perfect_motion_stays_on_the_curve(curve: str, base: dict[str, Any], rate: float, tracking: str) -> None:
    """At 0.4 m/s: 15 mm at 5 Hz, where a base that accelerates lags half a cycle behind each command, 3 mm at 20 Hz."""
    motion = FollowTrajectory(CURVES[curve], params(frequency=rate, tracking=tracking), here=True)
    stage = Stage(motion, **base)
    last = stage.run()
    assert last.status is BehaviorStatus.DONE
    errors = true_errors(stage, motion)
    assert errors.max() < (0.015 if rate == 5.0 else 0.003)
    assert errors.mean() < 0.001
    # the robot knows its errors as well as anybody: localization and odometry are perfect
    assert last.data["error_max_m"] == pytest.approx(errors.max(), abs=1e-6)
    assert stage.robot.pose.distance_to(motion.trajectory.end) < (0.015 if rate == 5.0 else 0.003)
    assert np.abs(np.diff(stage.commands[:, 0])).max() <= 1.0 / rate + 1e-9
    assert np.abs(np.diff(stage.commands[:, 2])).max() <= 2.0 / rate + 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("curve", CURVES)
def test_slip_and_noise_cost_centimeters_in_the_map(curve: str, seed: int) -> None:
    """5 % slip and odometry noise per second of driving, headings that wander by 0.02 rad/√m: 1 cm in the mean, 5 cm at most."""
    motion = FollowTrajectory(CURVES[curve], params(), here=True)
    stage = Stage(motion, seed=seed, **NOISY)
    stage.run()
    errors = true_errors(stage, motion)
    assert errors.mean() < 0.01
    assert errors.max() < 0.05


@pytest.mark.slow
def test_by_odometry_alone_the_curve_drifts_but_the_odometry_follows_it() -> None:
    motion = FollowTrajectory(CURVES["heart"], params(), here=True, measured_in="odom")
    stage = Stage(motion, seed=1, **NOISY)
    last = stage.run()
    assert last.data["error_max_m"] < 0.05
    assert true_errors(stage, motion).max() > last.data["error_max_m"]


@pytest.mark.slow
def test_the_robot_turns_to_the_initial_heading_before_the_clock_starts() -> None:
    curve = CURVES["heart"].moved_to(Pose2D(START.x, START.y, START.yaw + 2.5), "map")
    motion = FollowTrajectory(curve, params())
    stage = Stage(motion)
    stage.run()
    assert motion.clock == pytest.approx(2.5 / 0.436, abs=1.0)
    assert true_errors(stage, motion).max() < 0.01


@pytest.mark.parametrize("tracking", ["kanayama", "samson"])
@pytest.mark.parametrize("speed", [0.1, 0.4, -0.3])
def test_both_laws_return_to_a_line_with_their_damping(tracking: str, speed: float) -> None:
    """A unit disturbance: the lateral error falls as a damped oscillator with the frequency |v| sqrt(20): overshoot below 8 %."""
    p = params(tracking=tracking)
    pose, dt = Pose2D(0.0, 0.1, 0.0), 0.01
    lateral = []
    for k in range(round(12.0 / abs(speed) / dt / 3.0)):
        reference = Pose2D(speed * k * dt, 0.0, 0.0)
        v, w = track(tracking_error(pose, reference), speed, 0.0, p)
        pose = Pose2D(
            pose.x + v * math.cos(pose.yaw) * dt,
            pose.y + v * math.sin(pose.yaw) * dt,
            angle_between(0.0, pose.yaw + w * dt),
        )
        lateral.append(pose.y)
    assert min(lateral) > -0.008
    assert abs(lateral[-1]) < 1e-3
    assert abs(pose.yaw) < 1e-2


def test_samson_turns_round_from_a_heading_error_of_pi() -> None:
    error = TrackingError(0.0, 0.0, math.pi)
    assert abs(track(error, 0.3, 0.0, params(tracking="samson"))[1]) > 1.0
    assert abs(track(error, 0.3, 0.0, params(tracking="kanayama"))[1]) < 1e-9


# --- paths ------------------------------------------------------------------------------------------------------------


def test_a_path_is_timed_within_the_limits_and_followed() -> None:
    corner = np.array([(0.05 * k, 0.0, 0.0) for k in range(41)] + [(2.0, 0.05 * k, 0.0) for k in range(1, 31)])
    motion = FollowPath(Path(corner, "map"), params(follow_speed=0.4))
    stage = Stage(motion, start=Pose2D(0.0, 0.0, 0.5), **MOVING)
    assert stage.run().status is BehaviorStatus.DONE
    assert true_errors(stage, motion).max() < 0.02
    assert stage.robot.pose.distance_to(Pose2D(2.0, 1.5)) < 0.02
    assert np.abs(stage.commands[:, 0]).max() <= 0.4 + 1e-9


def test_no_corner_of_a_long_robot_skips_a_cell_of_the_check() -> None:
    """In curves of 0.15 m a corner moves six times as fast as the robot's center."""
    motion = FollowTrajectory(at_speed(figure_eight(0.8, 0.5, 60.0), 0.14), params(), here=True)
    stage = Stage(motion)
    stage.seen.footprint = Footprint(np.array([(0.9, 0.3), (0.9, -0.3), (-0.5, -0.3), (-0.5, 0.3)]))
    motion.start(stage.context, stage.robot.time)
    motion.step(stage.robot.state(), stage.robot.time)
    poses = motion.ahead(START, stage.robot.time, whole=True)
    placed = np.array([Transform2D(*pose).apply_points(stage.seen.footprint.vertices) for pose in poses.tolist()])
    moved = np.linalg.norm(np.diff(placed[1:], axis=0), axis=-1)
    assert moved.max() <= 0.05


# --- failures ---------------------------------------------------------------------------------------------------------


def test_a_trajectory_beyond_the_limits_is_refused_at_the_start() -> None:
    stage = Stage(FollowTrajectory(heart(1.0, 10.0), params(), here=True))
    with pytest.raises(InfeasibleTrajectoryError, match=r"cannot follow heart: .+ feasible in .+ times the time"):
        stage.run()


def test_a_trajectory_that_begins_elsewhere_is_refused() -> None:
    stage = Stage(FollowTrajectory(CURVES["heart"].moved_to(Pose2D(3.0, 3.0, 0.0), "map"), params()))
    with pytest.raises(InvalidMotionError, match=r"begins at \(3\.00, 3\.00, 0\.00\) in map, 4\.34 m from the robot"):
        stage.run()


def test_a_robot_that_is_left_behind_loses_the_trajectory() -> None:
    stage = Stage(FollowTrajectory(CURVES["heart"], params(), here=True), velocity_lag=1e3)
    with pytest.raises(
        TrackingLostError, match=r"follow is 0\.5. m from the trajectory after .+ max_tracking_error, 0\.5 m"
    ):
        stage.run()


@pytest.mark.slow
def test_following_stops_before_an_obstacle() -> None:
    curve = CURVES["figure_eight"].moved_to(START, "map")
    at = curve.at(8.0).pose
    appears = Stage(FollowTrajectory(curve, MotionParams()), **MOVING)
    motion, robot = appears.motion, appears.robot
    motion.start(appears.context, 0.0)
    commands = []
    with pytest.raises(MotionCollisionError, match=r"follow: followed figure_eight for .+ and stopped"):
        for k in range(400):
            robot.advance_to(0.05 * k)
            if k == 100:
                appears.wall(at.x, at.y)
            step = motion.step(robot.state(), robot.time)
            commands.append(step.twist)
            robot.command(step.twist)
    assert robot.pose.distance_to(at) > 0.18 + 0.03
    assert max(abs(b.vx - a.vx) for a, b in itertools.pairwise(commands)) <= 0.05 + 1e-9
    known = Stage(FollowTrajectory(curve, MotionParams()))
    known.wall(at.x, at.y, known=True)
    with pytest.raises(
        MotionCollisionError, match="follow did not start: the footprint hits an obstacle of the global_costmap"
    ):
        known.run()
