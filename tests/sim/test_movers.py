"""Discs on tracks, and a robot among them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from navstack.core import Footprint, InputError, LaserScan, PointCloud, Pose2D, Twist2D
from navstack.sim import DoorMotion, LidarParams, Shape, SimParams, SimulatedRobot, Track, TrackedDiscs, World

CIRCLE = Footprint.from_radius(0.18)
AHEAD = SimParams(sensors={"laser": LidarParams(x=0.0, beams=1, range_min=0.0)})


def measured(data: LaserScan | PointCloud) -> bytes:
    return (data.ranges if isinstance(data, LaserScan) else data.points).tobytes()


def test_back_and_forth() -> None:
    tracked = TrackedDiscs([Track([(0, 0), (3, 0), (3, 1)], 0.5, 0.2)])
    places = [tracked.discs(t)[0].tolist() for t in (0, 2, 6, 7, 8, 9, 15, 16, 17)]
    expected = [(0, 0), (1, 0), (3, 0), (3, 0.5), (3, 1), (3, 0.5), (0.5, 0), (0, 0), (0.5, 0)]
    assert places == [pytest.approx([x, y, 0.2]) for x, y in expected]


def test_closed_tracks_forwards_and_backwards() -> None:
    square = [(0, 0), (1, 0), (1, 1), (0, 1)]
    tracked = TrackedDiscs(
        [Track(square, 1.0, 0.1, closed=True, start_offset=0.5), Track(square, -1.0, 0.3, closed=True)]
    )
    assert tracked.discs(3.0)[:, :2] == pytest.approx(np.array([[0.0, 0.5], [1.0, 0.0]]))
    assert tracked.discs(403.0) == pytest.approx(tracked.discs(3.0))
    assert tracked.discs(3.0)[:, 2].tolist() == [0.1, 0.3]


def test_every_disc_stays_on_its_track_at_its_speed() -> None:
    rng = np.random.default_rng(0)
    tracks = [Track(rng.uniform(0, 5, (4, 2)) + 20 * k, float(rng.uniform(-2, 2)), 0.1, bool(k % 2)) for k in range(50)]
    tracked = TrackedDiscs(tracks)
    step = 1e-3
    for t in rng.uniform(0, 100, 20):
        here, there = tracked.discs(t), tracked.discs(t + step)
        assert (np.floor(here[:, 0] / 20) == np.arange(50)).all()
        moved = np.hypot(*(there - here)[:, :2].T)
        speeds = np.abs([track.speed for track in tracks])
        assert (moved <= step * speeds + 1e-12).all()
        # but where it turned a corner
        assert np.isclose(moved, step * speeds, rtol=1e-6).mean() > 0.9


def test_invalid_tracks_are_rejected() -> None:
    for track, message in (
        (Track([(0, 0)], 1.0, 0.1), "two points"),
        (Track([(0, 0), (1,)], 1.0, 0.1), "two points"),
        (Track([(0, 0), (0, 0)], 1.0, 0.1), "no length"),
        (Track([(0, 0), (1, math.nan)], 1.0, 0.1), "finite"),
        (Track([(0, 0), (1, 0)], 1.0, 0.0), "radius above 0"),
    ):
        with pytest.raises(InputError, match=message):
            TrackedDiscs([track])
    assert TrackedDiscs([]).discs(1.0).shape == (0, 3)


def test_a_scan_sees_discs_where_they_were_at_its_time() -> None:
    world = World(None, [[9.0, 9.0, 0.1]], [TrackedDiscs([Track([(5, 0), (2, 0)], 1.0, 0.5)])])
    robot = SimulatedRobot(AHEAD, world, CIRCLE, Pose2D(0, 0, 0))
    robot.advance_to(2.0)  # fetched at the end, after the disc has moved on
    for scan in robot.scans():
        assert scan.ranges[0] == pytest.approx(4.5 - scan.stamp, abs=1e-6)


def test_a_disc_that_hits_a_stopped_robot_is_one_collision_and_does_not_block_it() -> None:
    world = World(None, (), [TrackedDiscs([Track([(2, 0), (-2, 0)], 1.0, 0.3)])])
    robot = SimulatedRobot(AHEAD, world, CIRCLE, Pose2D(0, 0, 0))
    robot.advance_to(1.6)
    assert [(c.kind, c.index) for c in robot.collisions] == [("disc", 0)]
    assert robot.collisions[0].time == pytest.approx(1.52 + 0.02, abs=0.021)  # 2 - 0.3 - 0.18 m at 1 m/s
    assert robot.collisions[0].at[0] == pytest.approx(0.48, abs=0.021)
    assert robot.in_collision
    assert robot.pose == Pose2D(0, 0, 0)
    robot.command(Twist2D(0, 0, 0.5))
    robot.advance_to(1.8)
    assert robot.pose.yaw == pytest.approx(0.1)
    robot.advance_to(3.9)  # it has passed
    assert not robot.in_collision
    assert len(robot.collisions) == 1
    robot.advance_to(6.0)  # and comes again
    assert len(robot.collisions) == 2


def test_driving_into_a_moving_disc_is_one_collision() -> None:
    world = World(None, (), [TrackedDiscs([Track([(2, 0), (-2, 0)], 0.3, 0.3)])])
    robot = SimulatedRobot(AHEAD, world, CIRCLE, Pose2D(0, 0, 0))
    robot.command(Twist2D(0.5))
    robot.advance_to(3.0)
    assert len(robot.collisions) == 1


def test_an_approaching_obstacle_stops_the_robot_and_is_not_passed_through() -> None:
    world = World(None, (), [TrackedDiscs([Track([(2, 0), (-9, 0)], 0.5, 0.3)])])
    for acceleration in (None, 1.0):
        robot = SimulatedRobot(SimParams(acc_lim_x=acceleration, lasers=[]), world, CIRCLE, Pose2D(0, 0, 0))
        robot.command(Twist2D(0.5))
        held = None
        while world.discs_at(robot.time)[0, 0] - 0.32 > robot.pose.x:  # until it lies over the robot's middle
            robot.advance_to(robot.time + 0.02)
            if robot.collisions:
                held = held or robot.pose
                assert robot.pose == held
                assert robot.state().velocity.speed == 0.0
        assert len(robot.collisions) == 1


def test_the_robot_can_leave_an_overlapping_obstacle_but_not_through_it() -> None:
    door = Shape(
        segment=[[0.3, 1], [0.3, -1]], motion=DoorMotion(style="sliding", slide=[0, 2], open=[[0, 1]], moving_time=0.0)
    )
    box = Footprint(np.array([[0.35, 0.2], [-0.35, 0.2], [-0.35, -0.2], [0.35, -0.2]]))
    robot = SimulatedRobot(SimParams(lasers=[]), World(None, shapes=[door]), box, Pose2D(-1, 0, 0))
    robot.command(Twist2D(1.0))
    robot.advance_to(2.0)
    (collision,) = robot.collisions
    assert collision.time == pytest.approx(1.02, abs=0.021)
    assert robot.pose.x == pytest.approx(0.0, abs=0.021)
    robot.command(Twist2D(-0.5))
    robot.advance_to(3.0)
    assert robot.pose.x == pytest.approx(-0.5, abs=0.021)
    assert not robot.in_collision


def test_moving_obstacles_do_not_depend_on_the_division_into_calls() -> None:
    rng = np.random.default_rng(1)
    tracks = [Track(rng.uniform(-4, 4, (3, 2)), float(rng.uniform(0.2, 1)), 0.15) for _ in range(12)]
    world = World(None, (), [TrackedDiscs(tracks)])
    start = next(
        pose for pose in (Pose2D(x, 0.0, 0.0) for x in np.linspace(-4, 4, 40).tolist()) if world.is_free(CIRCLE, pose)
    )
    ends: list[tuple[object, ...]] = []
    for cuts in (1, 13):
        robot = SimulatedRobot(SimParams(acc_lim_x=1.0), world, CIRCLE, start)
        robot.command(Twist2D(0.4, 0.0, 0.2))
        for k in range(cuts):
            robot.advance_to(10.0 * (k + 1) / cuts)
        ends.append((robot.pose, robot.collisions, [measured(data) for data in robot.scans()]))
    assert ends[0] == ends[1]
    assert len(ends[0][1]) > 0  # pyright: ignore
