"""The body against closed forms; frames, time, commands, collision."""

from __future__ import annotations

import math

import numpy as np
import pytest

from navstack.core import (
    Footprint,
    GridGeometry,
    InputError,
    LaserScan,
    OccupancyGrid,
    PointCloud,
    Pose2D,
    Transform2D,
    Twist2D,
)
from navstack.plugins import Robot
from navstack.sim import LidarParams, SimParams, SimulatedRobot, World
from tests.sim.worlds import ascii_map

CIRCLE = Footprint.from_radius(0.18)
BOX = Footprint(np.array([[-0.3, -0.2], [0.3, -0.2], [0.3, 0.2], [-0.3, 0.2]]))


def robot(params: SimParams | None = None, world: World | None = None, start: Pose2D = Pose2D(0, 0, 0), **kw: int):
    return SimulatedRobot(params or SimParams(), world or World(), CIRCLE, start, **kw)


def test_implements_the_robot_protocol() -> None:
    made: Robot = robot()
    assert made.state().frame == "odom"


# --- motion ---------------------------------------------------------------------------------------------------------


def test_turning_circle() -> None:
    """v = 0.5, w = 0.5: a circle of 1 m radius; after a full turn the robot is at its start."""
    it = robot()
    it.command(Twist2D(0.5, 0.0, 0.5))
    samples = it.advance_to(4 * math.pi)
    center = np.hypot(samples[:, 0], samples[:, 1] - 1.0)
    # the chord of a step is as long as its arc: the radius grows by (w dt)² / 24 = 4e-6 m, twice that off the first center
    assert center == pytest.approx(1.0, abs=1e-5)
    assert it.distance_travelled == pytest.approx(0.5 * it.time)
    assert it.pose.distance_to(Pose2D(0, 0)) < 0.02


def test_acceleration_and_stopping_distance() -> None:
    """0 -> 0.5 m/s at 1 m/s² and back: v² / 2a each, within half a step's travel."""
    it = robot(SimParams(acc_lim_x=1.0, acc_lim_theta=2.0))
    it.command(Twist2D(0.5))
    it.advance_to(0.5)
    assert it.state().velocity.vx == pytest.approx(0.5)
    assert it.pose.x == pytest.approx(0.125, abs=0.5 * 0.02)
    start = it.pose.x
    it.command(Twist2D())
    it.advance_to(2.0)
    assert it.pose.x - start == pytest.approx(0.125, abs=0.5 * 0.02)
    assert it.state().velocity == Twist2D(0, 0, 0)
    it.command(Twist2D(0, 0, 1.0))
    it.advance_to(2.25)
    assert it.state().velocity.wz == pytest.approx(2.0 * 0.26, abs=1e-12)


def test_lag_is_first_order() -> None:
    it = robot(SimParams(velocity_lag=0.1))
    it.command(Twist2D(1.0))
    samples = it.advance_to(0.5)
    t = np.arange(1, 26) * 0.02
    assert samples[:, 6] == pytest.approx(1.0 - np.exp(-t / 0.1))


def test_command_delay_and_timeout() -> None:
    it = robot(SimParams(command_delay=0.1, command_timeout=0.25))
    it.command(Twist2D(0.4))
    samples = it.advance_to(1.0)
    driven = np.nonzero(samples[:, 6])[0]
    # steps 6 .. 18: from 0.1 s on, for 0.25 s, rounded up to whole steps of 0.02 s
    assert driven.tolist() == list(range(5, 18))


def test_a_later_command_replaces_an_earlier_one_of_the_same_step() -> None:
    it = robot()
    it.command(Twist2D(0.4))
    it.command(Twist2D(0.1))
    it.advance_to(0.1)
    assert it.pose.x == pytest.approx(0.01)


def test_differential_never_moves_sideways_holonomic_does() -> None:
    for kinematics, y in (("differential", 0.0), ("holonomic", 0.1)):
        it = robot(SimParams(kinematics=kinematics))  # pyright: ignore
        it.command(Twist2D(0.2, 0.1, 0.0))
        it.advance_to(1.0)
        assert tuple(it.pose) == pytest.approx((0.2, y, 0.0))


def test_the_division_into_calls_does_not_matter() -> None:
    """Identical to the bit in one call and in fifty, noise included."""
    params = SimParams(acc_lim_x=1.0, wheel_slip=0.1, odometry_noise=0.1, command_delay=0.05)
    once, often = robot(params, seed=3), robot(params, seed=3)
    for it, cuts in ((once, 1), (often, 50)):
        for leg, command in enumerate((Twist2D(0.5, 0, 0.3), Twist2D(0.2, 0, -0.5))):
            it.command(command)
            for k in range(cuts):
                it.advance_to(leg + (k + 1) / cuts)
    assert once.pose == often.pose
    assert once.state() == often.state()
    assert once.frames.lookup("map", "base_footprint", 1.7) == often.frames.lookup("map", "base_footprint", 1.7)


# --- time, frames, scans ----------------------------------------------------------------------------------------------


def test_time_is_in_whole_steps_and_never_before_the_requested_time() -> None:
    it = robot()
    it.advance_to(0.05)
    assert it.time == 0.06
    it.advance_to(0.05)
    assert it.time == 0.06
    for k in range(1, 1001):
        it.advance_to(k * 0.1)  # 0.1 is no binary fraction: the sum of steps would drift, the count does not
    assert it.time == 100.0


def test_frames_map_to_odom_offset() -> None:
    params = SimParams(map_to_odom=[1.0, 2.0, math.pi / 2])
    it = robot(params, start=Pose2D(1.0, 3.0, math.pi))
    assert tuple(it.state().pose) == pytest.approx((1.0, 0.0, math.pi / 2))
    it.command(Twist2D(0.5, 0.0, 0.1))
    it.advance_to(3.0)
    assert tuple(it.frames.lookup("map", "base_footprint", 3.0)) == pytest.approx(tuple(it.pose))
    assert tuple(it.frames.lookup("odom", "base_footprint", 3.0)) == pytest.approx(tuple(it.state().pose))
    laser = it.frames.lookup("base_footprint", "base_laser_link", 3.0)
    assert tuple(laser) == (0.1, 0.0, 0.0)
    # a pose between two steps is interpolated between two true ones
    assert it.frames.lookup("odom", "base_footprint", 1.99).x == pytest.approx(
        0.5 * (it.frames.lookup("odom", "base_footprint", 1.98).x + it.frames.lookup("odom", "base_footprint", 2.0).x)
    )


def test_drift_and_localization() -> None:
    for localization in ("truth", "odometry"):
        params = SimParams(odometry_noise=0.2, localization=localization)  # pyright: ignore
        it = robot(params, seed=1)
        it.command(Twist2D(0.5, 0.0, 0.2))
        it.advance_to(10.0)
        believed = it.frames.lookup("map", "base_footprint", it.time)
        assert it.state().pose.distance_to(it.pose) > 0.05
        if localization == "truth":
            assert tuple(believed) == pytest.approx(tuple(it.pose))
        else:
            assert tuple(believed) == tuple(it.state().pose)


@pytest.mark.slow
def test_energy_of_the_odometry_noise() -> None:
    """0.1 over a second at 1 m/s: after 4 s the error of the length has a deviation of 0.1 sqrt(4) m."""
    errors: list[float] = []
    for seed in range(300):
        it = robot(SimParams(odometry_noise=0.1), seed=seed)
        it.command(Twist2D(1.0))
        it.advance_to(4.0)
        errors.append(it.state().pose.x - it.pose.x)
    assert it.pose.x == pytest.approx(4.0)
    assert np.std(errors) == pytest.approx(0.2, rel=0.15)
    assert abs(np.mean(errors)) < 4 * 0.2 / math.sqrt(300)


@pytest.mark.slow
@pytest.mark.parametrize("frequency", [20.0, 100.0])
def test_the_heading_drifts_with_the_square_root_of_the_distance(frequency: float) -> None:
    """0.05 rad for a meter: after 4 m the heading has a deviation of 0.1 rad, the lateral error one of 0.05 sqrt(4^3 / 3) m."""
    true: list[tuple[float, float]] = []
    reported: list[tuple[float, float]] = []
    for seed in range(300):
        it = robot(
            SimParams(physics_frequency=frequency, wheel_slip_turn=0.05, odometry_noise_turn=0.025, lasers=[]),
            seed=seed,
        )
        it.command(Twist2D(0.8))
        it.advance_to(5.0)
        true.append((it.pose.yaw, it.pose.y))
        reported.append((it.state().pose.yaw, it.state().pose.y))
    lateral = 0.05 * math.sqrt(4.0**3 / 3.0)
    assert np.std(true, axis=0) == pytest.approx([0.1, lateral], rel=0.15)
    assert np.std(reported, axis=0) == pytest.approx([0.05, lateral / 2.0], rel=0.15)
    assert (np.abs(np.mean(true, axis=0)) < 4.0 * np.array([0.1, lateral]) / math.sqrt(300)).all()
    assert abs(np.corrcoef(np.array(true)[:, 0], np.array(reported)[:, 0])[0, 1]) < 0.25


def test_scans_are_taken_where_the_robot_was_at_their_times() -> None:
    world = World(None, [[5.0, 0.0, 1.0]])
    it = robot(world=world)
    assert [scan.stamp for scan in it.scans()] == [0.0]
    it.command(Twist2D(0.5))
    it.advance_to(0.5)
    scans = it.scans()
    assert [scan.stamp for scan in scans] == pytest.approx([0.1, 0.2, 0.3, 0.4, 0.5])
    for scan in scans:
        middle = (scan.ranges[319] + scan.ranges[320]) / 2
        assert middle == pytest.approx(3.9 - 0.5 * scan.stamp, abs=1e-4)
    assert it.scans() == []


def test_a_frequency_that_does_not_divide_that_of_the_physics() -> None:
    it = robot(SimParams(sensors={"laser": LidarParams(frequency=15.0)}))
    it.advance_to(2.0)
    stamps = [scan.stamp for scan in it.scans()]
    assert len(stamps) == 31
    assert np.array(stamps) == pytest.approx(np.ceil(np.arange(31) * 50 / 15 - 1e-9) / 50)


def test_two_lidars() -> None:
    front, rear = LidarParams(frame="front", topic="a"), LidarParams(frame="rear", topic="b", yaw=math.pi, frequency=5)
    it = robot(SimParams(lasers=["front", "rear"], sensors={"front": front, "rear": rear}))
    it.advance_to(0.4)
    assert "".join(scan.topic for scan in it.scans()) == "abaabaab"
    with pytest.raises(InputError, match="two sensors have the frame"):
        robot(SimParams(lasers=["a", "b"], sensors={"a": LidarParams(), "b": LidarParams(yaw=1.0)}))


@pytest.mark.parametrize("kind", ["PointCloud2", "PointCloud"])
def test_a_cloud_holds_the_points_that_the_beams_of_the_scan_hit(kind: str) -> None:
    both = {
        "scan": LidarParams(frame="a", topic="scan", fov=2.0, beams=41, x=0.2, yaw=0.3, range_min=0.05),
        "cloud": LidarParams(frame="b", topic="cloud", fov=2.0, beams=41, x=0.2, yaw=0.3, range_min=0.05, height=0.4),
    }
    both["cloud"] = both["cloud"].model_copy(update={"message": kind})
    it = robot(SimParams(lasers=["scan", "cloud"], sensors={**both}), world=corridor(2, 0.05))
    scan, cloud = it.scans()
    assert isinstance(scan, LaserScan) and isinstance(cloud, PointCloud)
    angles = scan.angle_min + scan.angle_increment * np.arange(41)
    seen = np.isfinite(scan.ranges)
    assert 0 < seen.sum() < 41
    expected = np.column_stack((np.cos(angles), np.sin(angles)))[seen] * scan.ranges[seen, None]
    assert np.allclose(cloud.points[:, :2], expected, atol=1e-6) and np.all(cloud.points[:, 2] == np.float32(0.4))


# --- collision ----------------------------------------------------------------------------------------------------------


def corridor(wall_cells: int, resolution: float) -> World:
    """A wall across x = 2 .. , everything else free; 4 m x 2 m, y from -1."""
    data = np.zeros((round(2 / resolution), round(4 / resolution)), np.int8)
    at = round(2 / resolution)
    data[:, at : at + wall_cells] = 100
    return World(OccupancyGrid(data, GridGeometry(data.shape[1], data.shape[0], resolution, 0.0, -1.0)))


@pytest.mark.parametrize("speed", [0.3, 2.0, 5.0])
@pytest.mark.parametrize("footprint", [CIRCLE, BOX, Footprint.from_radius(0.02)], ids=["round", "box", "tiny"])
def test_no_motion_through_a_wall_of_one_centimeter(speed: float, footprint: Footprint) -> None:
    it = SimulatedRobot(SimParams(), corridor(1, 0.01), footprint, Pose2D(0.5, 0.003, 0.0))
    it.command(Twist2D(speed))
    it.advance_to(8.0)
    front = it.pose.x + float(footprint.vertices[:, 0].max())
    assert 2.0 - 0.005 <= front <= 2.0
    assert len(it.collisions) == 1
    collision = it.collisions[0]
    assert collision.kind == "map"
    assert collision.at[0] == pytest.approx(2.005)
    assert collision.pose == it.pose
    assert collision.time == pytest.approx((2.0 - float(footprint.vertices[:, 0].max()) - 0.5) / speed, abs=0.021)
    assert it.state().velocity == Twist2D(0, 0, 0)


def test_no_rotation_over_a_thin_post() -> None:
    """The corner of a long box passes a post of 1 cm at 4 rad/s: 0.1 m of arc per step."""
    footprint = Footprint(np.array([[-1.2, -0.2], [1.2, -0.2], [1.2, 0.2], [-1.2, 0.2]]))
    post = (1.2 * math.cos(1.0), 1.2 * math.sin(1.0), 0.005)
    it = SimulatedRobot(SimParams(), World(None, [post]), footprint, Pose2D(0, 0, 0))
    it.command(Twist2D(0, 0, 4.0))
    it.advance_to(3.0)
    assert [collision.kind for collision in it.collisions] == ["disc"]
    assert it.pose.yaw < 1.0


def test_a_collision_counts_once_until_it_is_left() -> None:
    it = robot(world=corridor(10, 0.05), start=Pose2D(1.0, 0.0, 0.0))
    for k in range(20):  # pushed twenty times
        it.command(Twist2D(0.5))
        it.advance_to(3.0 + 0.2 * k)
    assert len(it.collisions) == 1
    assert it.in_collision
    it.command(Twist2D(-0.5))
    it.advance_to(it.time + 0.5)
    assert not it.in_collision
    it.command(Twist2D(0.5))
    it.advance_to(it.time + 2.0)
    assert len(it.collisions) == 2


def test_the_wheels_stop_with_the_robot() -> None:
    it = robot(world=corridor(10, 0.05), start=Pose2D(1.0, 0.0, 0.0))
    it.command(Twist2D(0.5))
    it.advance_to(5.0)
    assert it.state().pose == it.pose
    assert it.distance_travelled == pytest.approx(it.pose.x - 1.0)


def test_a_start_in_a_wall_is_rejected() -> None:
    with pytest.raises(InputError, match=r"the start \(1.9, 0, 0\) collides with the map at \(2\.0"):
        robot(world=corridor(10, 0.05), start=Pose2D(1.9, 0.0, 0.0))


@pytest.mark.parametrize("pose", [Pose2D(math.nan, 0, 0), Pose2D(0, math.inf, 0), Pose2D(0, 0, math.nan)])
def test_queries_at_poses_that_are_not_finite_are_rejected(pose: Pose2D) -> None:
    world = World(None, [[1.0, 1.0, 0.2]])
    footprint = Footprint.from_radius(0.2)
    for ask in (
        lambda: world.is_free(footprint, pose),
        lambda: world.clearance(pose),
        lambda: world.collision(footprint, pose),
    ):
        with pytest.raises(InputError, match="is not finite"):
            ask()


@pytest.mark.parametrize("discs", [[[0.0, 1.0]], [[None, 1.0]], [["a", 1.0, 0.2]]])
def test_malformed_discs_are_rejected(discs: list[list[float]]) -> None:
    with pytest.raises(InputError, match="not a row of three numbers"):
        World(None, discs)


def test_a_negative_seed_is_rejected() -> None:
    with pytest.raises(InputError, match="the seed is -1"):
        robot(seed=-1)


def test_commands_that_are_not_finite_are_rejected() -> None:
    with pytest.raises(InputError, match="finite"):
        robot().command(Twist2D(math.nan))
    with pytest.raises(InputError, match="cannot simulate"):
        robot().advance_to(math.inf)


def test_bad_parameters_are_refused() -> None:
    with pytest.raises(ValueError, match="map_to_odom"):
        SimParams(map_to_odom=[0.0])
    with pytest.raises(ValueError, match="a is used twice"):
        SimParams(lasers=["a", "a"])
    with pytest.raises(ValueError, match="range_min = 2 is not less than range_max = 1"):
        LidarParams(range_min=2.0, range_max=1.0)
    with pytest.raises(InputError, match="radius above 0"):
        World(None, [[1.0, 2.0, 0.0]])


def test_transform_of_the_grid_does_not_change_a_run() -> None:
    """The same walls in a grid rotated by 90 degrees give the same collision."""
    text = """
....#...
....#...
....#...
....#...
"""
    plain = ascii_map(text, 0.5)
    turned = OccupancyGrid(np.rot90(plain.data, 1).copy(), GridGeometry(4, 8, 0.5, 4.0, 0.0), math.pi / 2)
    ends: list[Pose2D] = []
    for grid in (plain, turned):
        it = SimulatedRobot(SimParams(), World(grid), BOX, Pose2D(0.6, 1.0, 0.1))
        it.command(Twist2D(0.5, 0.0, 0.02))
        it.advance_to(6.0)
        assert len(it.collisions) == 1
        ends.append(it.pose)
    assert tuple(ends[0]) == pytest.approx(tuple(ends[1]), abs=0.006)
    assert Transform2D().is_identity()
