"""Simulated robots that localize themselves: amcl, scan matching, filtered odometry, kidnapping."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from navstack.bringup import simulated_robot
from navstack.core import Pose2D, Twist2D
from navstack.localization import Amcl
from navstack.map_io import load_map
from navstack.parameters import load_configuration
from navstack.sim import SimulatedRobot

START = Pose2D(2.5, 9.7, 0.0)
OFFICE = Path(__file__).resolve().parents[2] / "maps" / "office.yaml"
LIDAR = ("navstack/sim/laser/fov=4.0", "navstack/sim/laser/beams=180", "navstack/sim/laser/range_max=10.0")
DRIFT = ("navstack/sim/odometry_turn=0.05", "navstack/sim/wheel_slip=0.05", "navstack/sim/odometry_noise=0.02")


def robot(*settings: str, seed: int = 1) -> SimulatedRobot:
    overrides = [*LIDAR, *settings]
    configuration = load_configuration(["turtlebot"], overrides=overrides)
    return simulated_robot(configuration, load_map(OFFICE), START, seed=seed)


def drive(it: SimulatedRobot, seconds: float, twist: Twist2D = Twist2D(0.3, 0.0, 0.3)) -> list[float]:
    """Drive; return the error of the believed position (m) every half second."""
    errors: list[float] = []
    until = it.time + seconds
    while it.time < until - 1e-6:
        it.command(twist)
        it.advance_to(it.time + 0.5)
        it.scans()
        believed = it.frames.lookup(it.map_frame, it.base_frame)
        errors.append(math.hypot(believed.x - it.pose.x, believed.y - it.pose.y))
    return errors


@pytest.mark.slow
def test_amcl_holds_the_pose_against_drift() -> None:
    lost = drive(robot(*DRIFT, "navstack/sim/localization=odometry"), 60.0)
    held = drive(
        robot(*DRIFT, "navstack/sim/localization=amcl", "navstack/sim/initial_pose_error=[0.2, -0.1, 0.05]"), 60.0
    )
    assert held[0] == pytest.approx(math.hypot(0.2, 0.1), abs=0.1)
    assert max(held[60:]) < 0.35
    assert max(lost[60:]) > 2.0 * max(held[60:])


@pytest.mark.slow
def test_the_same_seed_gives_the_same_estimates() -> None:
    settings = (*DRIFT, "navstack/sim/localization=amcl")
    assert drive(robot(*settings), 10.0) == drive(robot(*settings), 10.0)
    assert drive(robot(*settings), 10.0) != drive(robot(*settings, seed=2), 10.0)


def test_scans_reach_localizer_and_costmaps() -> None:
    it, plain = robot("navstack/sim/localization=amcl"), robot()
    it.advance_to(1.0)
    plain.advance_to(1.0)
    assert [scan.stamp for scan in it.scans()] == [scan.stamp for scan in plain.scans()]
    assert it.scans() == []


def test_a_kidnapped_robot_does_not_know_it() -> None:
    it = robot("navstack/sim/localization=amcl")
    drive(it, 5.0)
    before = it.frames.lookup(it.map_frame, it.odom_frame)
    away = Pose2D(it.pose.x + 0.5, it.pose.y + 0.5, it.pose.yaw)
    it.place(away, inform_localization=False)
    assert it.frames.lookup(it.map_frame, it.odom_frame) == before
    assert it.pose == away
    it.place(START)
    believed = it.frames.lookup(it.map_frame, it.base_frame)
    assert believed.x == pytest.approx(START.x)
    assert drive(it, 5.0)[-1] < 0.3


def test_the_filter_removes_the_wheels_turn_error() -> None:
    turn: dict[str, float] = {}
    for odometry in ("wheels", "ekf"):
        settings = ("navstack/sim/odometry_turn=0.1", "navstack/sim/imus=[imu]", f"navstack/sim/odometry={odometry}")
        it = robot(*settings)
        drive(it, 20.0)
        turn[odometry] = abs(math.remainder(it.state().pose.yaw - it.pose.yaw, 2.0 * math.pi))
    assert turn["wheels"] == pytest.approx(0.1 * 0.3 * 20.0, rel=0.05)
    assert turn["ekf"] < 0.05 * turn["wheels"]


def test_amcl_gets_its_section() -> None:
    it = robot("navstack/sim/localization=amcl", "amcl/max_particles=300", "amcl/min_particles=200")
    localizer: Any = it.estimation.localizer
    assert isinstance(localizer.tracker, Amcl)
    assert localizer.tracker.params.max_particles == 300


@pytest.mark.slow
def test_scan_matching_starts_without_a_pose() -> None:
    it = robot("navstack/sim/localization=scan_matching", "navstack/sim/initial_pose=unknown")
    errors = drive(it, 40.0)
    assert errors[-1] < 0.3
