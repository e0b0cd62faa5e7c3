"""Sonars, IMUs, heights, what a beam without a hit reports, and the frames of a noisy localization."""

from __future__ import annotations

import math

import numpy as np
import pytest

from navstack.core import Footprint, InputError, LaserScan, Pose2D, RangeReading, Transform2D, Twist2D, angle_between
from navstack.sim import ImuParams, LidarParams, Shape, SimParams, SimulatedRobot, SonarParams, World
from tests.sim.worlds import ascii_map

CIRCLE = Footprint.from_radius(0.18)


def robot(params: SimParams, world: World | None = None, *, seed: int = 0, start: Pose2D = Pose2D(0, 0, 0)):
    return SimulatedRobot(params, world or World(), CIRCLE, start, seed=seed)


def sonar_of(world: World, **more: object) -> RangeReading:
    params = SimParams(lasers=[], bumpers=[], sonars=["ping"], sensors={"ping": SonarParams(x=0.0, **more)})  # pyright: ignore
    (reading,) = robot(params, world).scans()
    assert isinstance(reading, RangeReading)
    return reading


# --- sonar ------------------------------------------------------------------------------------------------------------


def test_a_sonar_reports_the_nearest_obstacle_in_its_cone() -> None:
    beside = [[1.5 * math.cos(0.2), 1.5 * math.sin(0.2), 0.1], [2.0, 0.0, 0.1], [0.9, 0.9, 0.1]]
    reading = sonar_of(World(None, beside), fov=0.5, beams=201)
    # the disc to the side, not the one ahead, and not the one outside
    assert reading.range_m == pytest.approx(1.4, abs=1e-3)
    assert (reading.field_of_view, reading.min_range, reading.max_range) == (0.5, 0.02, 3.0)
    assert (reading.frame, reading.topic, reading.stamp) == ("sonar_link", "sonar", 0.0)
    assert sonar_of(World(None, beside), fov=0.1).range_m == pytest.approx(1.9)


def test_a_sonar_without_an_echo() -> None:
    assert sonar_of(World()).range_m == 3.0
    assert sonar_of(World(), no_return="inf").range_m == math.inf
    assert sonar_of(World(None, [[0.5, 0.0, 0.1]]), range_min=0.6).range_m == 0.6
    assert sonar_of(World(None, [[0.5, 0.0, 0.1]]), dropout=1.0).range_m == 3.0


def test_noise_of_a_sonar() -> None:
    params = SimParams(
        lasers=[], bumpers=[], sonars=["ping"], sensors={"ping": SonarParams(x=0.0, frequency=50.0, range_noise=0.02)}
    )
    it = robot(params, World(None, [[2.0, 0.0, 0.5]]), seed=1)
    it.advance_to(20.0)
    ranges = np.array([data.range_m for data in it.scans() if isinstance(data, RangeReading)])
    assert len(ranges) == 1001
    assert ranges.mean() == pytest.approx(1.5, abs=4 * 0.02 / math.sqrt(1001))
    assert ranges.std() == pytest.approx(0.02, rel=4 / math.sqrt(2002))


def test_delayed_measurements_arrive_late_with_the_stamp_and_the_values_of_their_time() -> None:
    """A sonar 0.25 s late next to one in time, on a robot that approaches an obstacle."""
    names = {"late": SonarParams(frame="a", delay=0.25), "prompt": SonarParams(frame="b")}
    params = SimParams(lasers=[], bumpers=[], sonars=["late", "prompt"], sensors=dict(names))
    arrived: list[tuple[float, str, float, float]] = []
    it = robot(params, World(None, [[2.0, 0.0, 0.5]]))
    it.command(Twist2D(0.5, 0.0, 0.0))
    for k in range(1, 21):
        it.advance_to(0.05 * k)
        arrived += [(it.time, r.frame, r.stamp, r.range_m) for r in it.scans() if isinstance(r, RangeReading)]
    values = {stamp: value for _, frame, stamp, value in arrived if frame == "b"}
    late = [(time, stamp, value) for time, frame, stamp, value in arrived if frame == "a"]
    assert [stamp for _, stamp, _ in late] == pytest.approx([0.1 * k for k in range(8)])
    assert all(0.25 - 1e-9 <= time - stamp <= 0.3 + 1e-9 and value == values[stamp] for time, stamp, value in late)
    assert values[0.0] > values[max(values)]


# --- lidar ------------------------------------------------------------------------------------------------------------


def test_a_beam_without_a_hit_can_report_the_maximum_range() -> None:
    lidar = {"x": 0.0, "beams": 3, "fov": 1.0, "range_min": 0.1, "range_max": 4.0}
    world = World(None, [[2.0, 0.0, 0.5]])
    found: list[list[float]] = []
    for no_return in ("inf", "max"):
        params = SimParams(bumpers=[], sensors={"laser": LidarParams(**lidar, no_return=no_return)})  # pyright: ignore
        (scan,) = robot(params, world).scans()
        assert isinstance(scan, LaserScan)
        found.append(scan.ranges.tolist())
    assert found == [[math.inf, 1.5, math.inf], [4.0, 1.5, 4.0]]


def test_low_lidars_see_low_obstacles() -> None:
    world = World(
        ascii_map(" " * 6, y=-0.5),
        [[5.0, 0.0, 0.2]],
        low_discs=[[2.0, 0.0, 0.2]],
        shapes=[Shape(box=[0.2, 1.0], pose=[3.0, 0.0], height=0.2), Shape(radius=0.2, pose=[4.0, 0.0], height=0.4)],
    )
    params = SimParams(
        bumpers=[],
        lasers=["a", "b", "c", "d"],
        sensors={
            name: LidarParams(frame=name, x=0.0, beams=1, range_min=0.1, height=height)
            for name, height in zip("abcd", (0.05, 0.15, 0.3, 0.5), strict=True)
        },
    )
    ranges = [data.ranges[0] for data in robot(params, world).scans() if isinstance(data, LaserScan)]
    assert ranges == pytest.approx([1.8, 2.9, 3.8, 4.8])


# --- IMU --------------------------------------------------------------------------------------------------------------


def imu(**more: object) -> SimParams:
    return SimParams(lasers=[], bumpers=[], imus=["gyro"], sensors={"gyro": ImuParams(**more)})  # pyright: ignore


def test_an_imu_reports_the_true_yaw_and_rate() -> None:
    it = robot(imu(yaw=0.5, frequency=25.0), start=Pose2D(0, 0, 3.0))
    it.command(Twist2D(0.2, 0.0, 0.5))
    it.advance_to(2.0)
    readings = it.imu_readings()
    assert [r.stamp for r in readings] == pytest.approx(np.arange(1, 51) * 0.04)
    for r in readings:
        assert math.hypot(*r.orientation) == pytest.approx(1.0)
        assert angle_between(r.yaw, 3.5 + 0.5 * r.stamp) == pytest.approx(0.0, abs=1e-9)
        assert r.yaw_rate == pytest.approx(0.5)
    assert not it.imu_readings()
    assert it.frames.lookup("base_footprint", "imu_link").yaw == 0.5


def test_the_imu_of_a_blocked_robot_reports_no_rotation() -> None:
    box = Footprint(np.array([[-0.2, -0.2], [0.2, -0.2], [0.2, 0.2], [-0.2, 0.2]]))
    it = SimulatedRobot(imu(), World(None, shapes=[Shape(box=[2, 0.1], pose=[0, 0.3])]), box, Pose2D(0, 0, 0))
    it.command(Twist2D(0.0, 0.0, 1.0))
    it.advance_to(2.0)
    assert it.imu_readings()[-1].yaw_rate == 0.0


def test_errors_of_an_imu() -> None:
    it = robot(imu(orientation_noise=0.02, yaw_rate_noise=0.01, yaw_rate_bias=0.003), seed=2)
    it.advance_to(40.0)
    readings = it.imu_readings()
    t = np.array([r.stamp for r in readings])
    n = len(t)
    rates = np.array([r.yaw_rate for r in readings])
    assert rates.mean() == pytest.approx(0.003, abs=4 * 0.01 / math.sqrt(n))
    assert rates.std() == pytest.approx(0.01, rel=4 / math.sqrt(2 * n))
    errors = np.array([r.yaw for r in readings]) - 0.003 * t  # the bias, summed up
    assert errors.mean() == pytest.approx(0.0, abs=4 * 0.02 / math.sqrt(n))
    assert errors.std() == pytest.approx(0.02, rel=4 / math.sqrt(2 * n))


@pytest.mark.slow
def test_the_bias_of_an_imu_drifts_with_the_given_deviation() -> None:
    ends: list[float] = []
    for seed in range(200):
        it = robot(imu(yaw_rate_drift=0.01, frequency=10.0), seed=seed)
        it.advance_to(4.0)
        ends.append(it.imu_readings()[-1].yaw_rate)
    assert np.std(ends) == pytest.approx(0.01 * 2.0, rel=4 / math.sqrt(400))


def test_imu_readings_do_not_depend_on_the_division_into_calls() -> None:
    found: list[list[object]] = []
    for cuts in (1, 17):
        it = robot(imu(orientation_noise=0.02, yaw_rate_noise=0.01, yaw_rate_drift=0.1, frequency=30.0), seed=3)
        it.command(Twist2D(0.1, 0.0, 0.3))
        readings: list[object] = []
        for k in range(cuts):
            it.advance_to(3.0 * (k + 1) / cuts)
            readings += it.imu_readings()
        found.append(readings)
    assert found[0] == found[1]


def test_sensor_names_are_unique() -> None:
    with pytest.raises(ValueError, match="the name of a lidar and of an IMU"):
        SimParams(lasers=["a"], imus=["a"])
    with pytest.raises(InputError, match="two sensors have the frame"):
        robot(SimParams(sonars=["a", "b"], sensors={"b": SonarParams(x=0.2)}))


# --- localization -----------------------------------------------------------------------------------------------------


def test_offsets_match_fake_localization() -> None:
    """Map -> base = T(-delta_yaw; -delta_x, -delta_y) times the true pose."""
    for noise in (0.0, 0.05):
        it = robot(SimParams(delta_x=1.0, delta_y=2.0, delta_yaw=math.pi / 2, odometry_noise=noise))
        it.command(Twist2D(0.5, 0.0, 0.2))
        it.advance_to(2.0)
        expected = Transform2D(-1.0, -2.0, -math.pi / 2).apply(it.pose)
        assert tuple(it.frames.lookup("map", "base_footprint", 2.0)) == pytest.approx(tuple(expected))
        assert tuple(expected)[:2] == pytest.approx((it.pose.y - 1.0, -it.pose.x - 2.0))


def test_noise_of_the_localization() -> None:
    it = robot(SimParams(localization_noise=0.03, localization_yaw_noise=0.02, localization_frequency=10.0), seed=1)
    it.advance_to(9.9)
    errors = np.array([tuple(it.frames.lookup("map", "base_footprint", 0.04 + 0.1 * k)) for k in range(98)])
    n = len(errors)
    assert np.abs(np.diff(errors[:, 0])).min() > 0.0  # redrawn at each update
    # and held until the next: 0.02 and 0.1 s are steps of the update before
    for a, b in ((0.04, 0.08), (5.04, 5.08)):
        assert it.frames.lookup("map", "odom", a) == it.frames.lookup("map", "odom", b)
    for column, sigma in ((0, 0.03), (1, 0.03), (2, 0.02)):
        assert errors[:, column].mean() == pytest.approx(0.0, abs=4 * sigma / math.sqrt(n))
        assert errors[:, column].std() == pytest.approx(sigma, rel=4 / math.sqrt(2 * n))
    again = robot(SimParams(localization_noise=0.03, localization_yaw_noise=0.02, localization_frequency=10.0), seed=1)
    for k in range(33):
        again.advance_to(0.3 * (k + 1))
    assert again.frames.lookup("map", "odom", 7.0) == it.frames.lookup("map", "odom", 7.0)


def test_a_delay_delays_the_correction() -> None:
    """The odometry overestimates by 2 %: the localization corrects it 0.2 s later."""
    it = robot(SimParams(odometry_scale=0.02, localization_delay=0.2))
    it.command(Twist2D(0.5))
    it.advance_to(4.0)
    estimate = it.frames.lookup("map", "base_footprint", 4.0)
    assert estimate.x - it.pose.x == pytest.approx(0.02 * 0.5 * 0.2)
    # without errors of the odometry, a delay does nothing
    exact = robot(SimParams(localization_delay=0.2, localization_yaw_noise=0.0))
    exact.command(Twist2D(0.5, 0.0, 0.3))
    exact.advance_to(4.0)
    assert tuple(exact.frames.lookup("map", "base_footprint", 4.0)) == pytest.approx(tuple(exact.pose))


def test_odometry_alone_is_not_corrected() -> None:
    it = robot(SimParams(localization="odometry", odometry_scale=0.02, localization_noise=0.5))
    it.command(Twist2D(0.5))
    it.advance_to(4.0)
    assert it.frames.lookup("map", "base_footprint", 4.0).x == pytest.approx(1.02 * it.pose.x)
