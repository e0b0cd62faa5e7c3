"""The scans of a record: at the rate of the sensor, at the poses of their measurement, bounded in number."""

from __future__ import annotations

import numpy as np
import pytest

from navstack.core import DeferredScan, LaserScan, Pose2D, RobotState, Transform2D, Twist2D
from navstack.parameters import load_configuration
from navstack.record import Record
from navstack.record.buffers import ScanBuffer
from navstack.scenario import Scenario, run_scenario
from tests.explain.rooms import RESOLUTION, two_rooms
from tests.record.test_record import a_recorder

MOUNTING = (0.15, -0.1, 0.3)


def driven(**options) -> Record:
    configuration = load_configuration(
        ["turtlebot"],
        overrides=[f"navstack/sim/laser/{k}={v}" for k, v in zip(("x", "y", "yaw"), MOUNTING, strict=True)],
    )
    scenario = Scenario(
        configuration=configuration,
        map=two_rooms({0.0: 1.2}),
        start=Pose2D(-1.5, -2.0, 0.4),
        goals=(Pose2D(1.0, -1.5, 0.0),),
    )
    recorder = run_scenario(scenario, **options).recorder
    assert recorder is not None
    return recorder.record()


@pytest.fixture(scope="module")
def run() -> Record:
    return driven()


def test_every_scan_of_the_simulated_lidar_is_recorded(run: Record) -> None:
    times = [scan.t for scan in run.scans]
    assert np.diff(times) == pytest.approx(0.1, abs=0.011)  # 10 Hz, at steps of 0.01 s
    assert len(times) == pytest.approx(10.0 * run.duration, abs=2.0)


def test_the_points_of_a_scan_are_on_the_obstacles(run: Record) -> None:
    grid = run.map
    assert grid is not None
    rows, columns = np.nonzero(grid.data == 100)
    walls = np.column_stack(grid.geometry.cell_to_world(columns, rows))
    for scan in run.scans[:: max(1, len(run.scans) // 8)]:
        assert tuple(scan.mounting) == MOUNTING
        points = scan.points[::20]
        assert len(points)
        away = np.hypot(*(points[:, None] - walls[None]).transpose(2, 0, 1)).min(axis=1)
        # half the diagonal of a cell, and three deviations of the lidar's noise
        assert away.max() < RESOLUTION * np.sqrt(0.5) + 0.03


def test_the_last_scan_of_every_lidar(run: Record) -> None:
    (scan,) = run.scans_at(3.0)
    assert 2.9 <= scan.t <= 3.0
    assert run.scans_at(-1.0) == ()


def test_scans_can_be_left_out() -> None:
    assert driven(scans=False).scans == ()


def test_scans_lie_between_the_samples_and_are_rounded_to_the_millimeter() -> None:
    recorder = a_recorder(sensors={"laser": Transform2D(0.1, 0.0, 0.0)})
    for i in range(3):
        recorder.sample(
            float(i),
            pose=Pose2D(2.0 * i, 0.0, 3.0 + 0.2 * i),
            odom=RobotState(Pose2D(0.0, 0.0), Twist2D(), 0.0),
            map_to_odom=Transform2D(),
            command=Twist2D(),
            state="CONTROLLING",
            goal_index=-1,
        )
    ranges = np.array([1.23456, np.inf, np.nan], np.float32)
    recorder.scan(0.5, LaserScan(ranges, 0.0, 0.1, 0.2, 5.0, 0.5, "laser"))
    ranges[:] = 0.0  # the recorder has a copy
    (scan,) = recorder.record().scans
    assert scan.pose == pytest.approx((1.0, 0.0, 3.1))
    assert scan.scan.ranges == pytest.approx([1.235, np.inf, np.nan], nan_ok=True)
    assert scan.base_points == pytest.approx(np.array([[1.335, 0.0]]))


def test_a_long_run_keeps_scans_of_its_whole_length_at_a_lower_rate() -> None:
    measured: list[int] = []

    def scan(i: int) -> DeferredScan:
        def ranges() -> np.ndarray:
            measured.append(i)
            return np.ones(100, np.float32)

        return DeferredScan(ranges, 0.0, 0.01, 0.1, 5.0, float(i))

    buffer = ScanBuffer(0, limit=1000)
    for i in range(100):
        buffer.add(float(i), scan(i), None)
    assert measured == [0]  # the run does not wait for the others
    times = buffer.times()
    assert 5 <= len(times) <= 10
    assert np.diff(times) == pytest.approx(times[1] - times[0])
    assert times[0] == 0.0
    assert times[-1] >= 100.0 - 2.0 * (times[1] - times[0])
    assert measured == [round(t) for t in times]
