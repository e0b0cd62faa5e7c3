"""Reproduces the simulator in which the C++ stack was measured on the BARN worlds: a Jackal among cylinders, without a map."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from navstack.core import Footprint, Pose2D, Twist2D
from navstack.sim import LidarParams, SimParams, SimulatedRobot, World

JACKAL = Footprint(np.array([[-0.21, -0.165], [0.21, -0.165], [0.21, 0.165], [-0.21, 0.165]]))
PARAMS = SimParams(
    physics_frequency=100.0,
    acc_lim_x=10.0,
    acc_lim_theta=20.0,
    command_timeout=0.25,
    sensors={
        "laser": LidarParams(
            topic="front/scan",
            frame="front_laser",
            x=0.055,
            height=0.2414,
            beams=720,
            fov=2 * 2.35619,
            range_min=0.1,
            range_max=10.0,
            frequency=20.0,
        )
    },
)
START, GOAL = Pose2D(0.0, 0.0, 1.57), Pose2D(0.0, 10.0, 0.0)


@pytest.fixture(scope="module")
def worlds(data_dir: Path) -> list[World]:
    file = data_dir / "barn" / "worlds.npz"
    if not file.exists():
        pytest.skip("no BARN worlds here")
    data = np.load(file)
    offsets, radius = data["cyl_offset"], float(data["cyl_radius"])
    found: list[World] = []
    for first, last in pairwise(offsets.tolist()):
        centers = data["cyl_xy"][first:last] - (-2.25, 3.0)
        found.append(World(None, np.column_stack((centers, np.full(len(centers), radius)))))
    return found


def test_start_and_goal_are_free_and_scans_see_every_cylinder_in_sight(worlds: list[World]) -> None:
    lidar = PARAMS.lidar("laser")
    angles = lidar.angle_min + lidar.angle_increment * np.arange(lidar.beams)
    for world in worlds:
        assert world.is_free(JACKAL, START)
        assert world.is_free(JACKAL, GOAL)
        robot = SimulatedRobot(PARAMS, world, JACKAL, START)
        scan = robot.scans()[0]
        eye = np.array([0.055 * math.cos(1.57), 0.055 * math.sin(1.57)])
        towards = np.column_stack((np.cos(1.57 + angles), np.sin(1.57 + angles)))
        # all beams against all discs, in one table
        centers, radius = world.discs_at(0.0)[:, :2] - eye, world.discs_at(0.0)[:, 2]
        along = towards @ centers.T
        under = radius**2 - ((centers**2).sum(axis=1) - along**2)
        hit = np.where((under >= 0) & (along > 0), along - np.sqrt(np.maximum(under, 0)), np.inf).min(axis=1)
        expected = np.where(hit > 10.0, np.inf, np.where(hit < 0.1, -np.inf, hit))
        np.testing.assert_allclose(scan.ranges, expected, atol=1e-5)
        assert np.isfinite(scan.ranges).any()


@pytest.mark.slow
def test_an_open_loop_drive_ends_at_the_first_cylinder(worlds: list[World]) -> None:
    """Straight ahead at 0.5 m/s: collision exactly where the footprint meets the first disc."""
    touched = 0
    for world in worlds[:20]:
        robot = SimulatedRobot(PARAMS, world, JACKAL, START)
        for k in range(500):
            robot.command(Twist2D(0.5))
            robot.advance_to(0.05 * (k + 1))
        if robot.collisions:
            touched += 1
            collision = robot.collisions[0]
            assert 0.0 < world.clearance(collision.pose, JACKAL) <= 0.005 + 1e-9
            assert len(robot.collisions) == 1
            assert robot.pose.distance_to(collision.pose) <= 0.005  # it goes on pushing
        else:
            assert robot.distance_travelled == pytest.approx(0.5 * robot.time, abs=0.02)
    assert touched > 5


def test_a_command_older_than_0_25_s_is_ignored() -> None:
    robot = SimulatedRobot(PARAMS, World(), JACKAL, START)
    robot.command(Twist2D(0.5))
    robot.advance_to(2.0)
    # 5 steps up to speed, 20 at it, 5 down, at 10 m/s² and 10 ms
    assert robot.distance_travelled == pytest.approx(0.5 * 0.25, abs=0.01)
    assert robot.state().velocity == Twist2D(0, 0, 0)
