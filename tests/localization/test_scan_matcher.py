"""Scan matching: tracking from a pose, global starts, kidnapping, odd inputs."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from navstack.core import InputError, LaserScan, OccupancyGrid, Pose2D, Transform2D
from navstack.localization.scan_matcher import ScanMatcher, ScanMatcherParams
from navstack.plugins import PoseEstimate
from tests.localization.rooms import free_pose, rooms, scan_from

SENSOR = Transform2D(0.1, 0.0, 0.0)


def drive(
    matcher: ScanMatcher, grid: OccupancyGrid, start: Transform2D, *, steps: int, drift: float = 0.02
) -> list[tuple[Transform2D, PoseEstimate]]:
    """Turns on a circle of 0.5 m from `start`, with odometry that drifts by `drift` rad per step of 0.1 m."""
    truth, odometry = start, Transform2D(5.0, -3.0, 1.0)
    found: list[tuple[Transform2D, PoseEstimate]] = []
    for k in range(steps):
        scan = stamped(scan_from(grid, truth, sensor=SENSOR), k)
        estimate = matcher.update(odometry, scan, SENSOR)
        if estimate is not None:
            found.append((truth, estimate))
        truth = truth @ Transform2D(0.1, 0.0, 0.2)
        odometry = odometry @ Transform2D(0.102, 0.0, 0.2 + drift)
    return found


def stamped(scan: LaserScan, stamp: float) -> LaserScan:
    return dataclasses.replace(scan, stamp=stamp)


def error(truth: Transform2D, estimate: PoseEstimate) -> tuple[float, float]:
    pose = estimate.pose
    yaw = abs(math.remainder(pose.yaw - truth.yaw, 2.0 * math.pi))
    return math.hypot(pose.x - truth.x, pose.y - truth.y), yaw


@pytest.fixture
def grid() -> OccupancyGrid:
    return rooms(yaw=0.3)


def center(grid: OccupancyGrid) -> Transform2D:
    return free_pose(grid, np.random.default_rng(4), margin=1.2)


def test_tracking_from_a_pose(grid: OccupancyGrid) -> None:
    matcher = ScanMatcher()
    matcher.set_map(grid)
    start = center(grid)
    matcher.set_pose(Pose2D(start.x + 0.15, start.y - 0.1, start.yaw + 0.1), np.diag([0.05, 0.05, 0.02]), 0.0)
    found = drive(matcher, grid, start, steps=40)
    errors = np.array([error(*pair) for pair in found[3:]])
    # half a cell of the map, whose walls the scan meets at their near side
    assert errors[:, 0].max() < 0.1
    assert errors[:, 1].max() < 0.05
    assert all(estimate.details["certain"] for _, estimate in found)
    truth, estimate = found[-1]
    odometry = estimate.map_to_odom.inverse() @ Transform2D(*estimate.pose)
    assert (estimate.map_to_odom @ odometry).x == pytest.approx(estimate.pose.x)
    assert np.linalg.eigvalsh(estimate.covariance).min() > 0.0
    assert truth is not None


def test_a_global_start_becomes_certain_of_the_true_pose(grid: OccupancyGrid) -> None:
    matcher = ScanMatcher()
    matcher.set_map(grid)
    matcher.start_globally()
    found = drive(matcher, grid, center(grid), steps=40)
    certain = [pair for pair in found if pair[1].details["certain"]]
    assert certain
    assert max(error(*pair)[0] for pair in certain) < 0.15
    assert found[0][1].details["certain"] is False
    assert sum(weight for _, _, weight in matcher.hypotheses()) == pytest.approx(1.0)


def test_two_equal_rooms_stay_ambiguous() -> None:
    cells = np.zeros((60, 121), np.int8)
    cells[[0, -1]] = 100
    cells[:, [0, 60, 120]] = 100
    cells[20:26, 12:15] = 100
    cells[20:26, 72:75] = 100
    grid = OccupancyGrid.from_array(cells, 0.1, values="occupancy")
    matcher = ScanMatcher()
    matcher.set_map(grid)
    matcher.start_globally()
    found = drive(matcher, grid, Transform2D(3.5, 3.5, 0.3), steps=40, drift=0.0)
    assert not any(estimate.details["certain"] for _, estimate in found)
    assert found[-1][1].details["hypotheses"] >= 2
    best = matcher.hypotheses()[:2]
    assert abs(best[0][0].x - best[1][0].x) == pytest.approx(6.0, abs=0.1)
    assert best[1][2] > 0.05


def test_equal_inputs_give_equal_estimates(grid: OccupancyGrid) -> None:
    results: list[list[PoseEstimate]] = []
    for _ in range(2):
        matcher = ScanMatcher()
        matcher.set_map(grid)
        matcher.start_globally()
        results.append([estimate for _, estimate in drive(matcher, grid, center(grid), steps=12)])
    assert [e.pose for e in results[0]] == [e.pose for e in results[1]]
    assert results[0][-1].details == results[1][-1].details


def test_a_resting_robot_gives_no_updates_unless_asked(grid: OccupancyGrid) -> None:
    matcher = ScanMatcher()
    matcher.set_map(grid)
    matcher.set_pose(Pose2D(*center(grid)), np.eye(3) * 0.01, 0.0)
    scan = scan_from(grid, center(grid), sensor=SENSOR)
    odometry = Transform2D()
    assert matcher.update(odometry, stamped(scan, 0.0), SENSOR) is not None
    assert matcher.update(odometry, stamped(scan, 0.1), SENSOR) is None
    matcher.request_update()
    assert matcher.update(odometry, stamped(scan, 0.2), SENSOR) is not None
    assert matcher.update(odometry, stamped(scan, 0.3), SENSOR) is None


def test_a_new_map_keeps_a_certain_pose(grid: OccupancyGrid) -> None:
    matcher = ScanMatcher()
    matcher.set_map(grid)
    start = center(grid)
    matcher.set_pose(Pose2D(*start), np.eye(3) * 0.01, 0.0)
    matcher.update(Transform2D(), scan_from(grid, start, sensor=SENSOR), SENSOR)
    matcher.set_map(rooms(yaw=0.3, resolution=0.05))
    estimate = matcher.update(Transform2D(), stamped(scan_from(grid, start, sensor=SENSOR), 0.1), SENSOR)
    assert estimate is not None
    assert error(start, estimate)[0] < 0.2


def test_odd_inputs_are_refused_and_change_nothing(grid: OccupancyGrid) -> None:
    with pytest.raises(InputError, match="set_map"):
        ScanMatcher().start_globally()
    matcher = ScanMatcher(ScanMatcherParams())
    matcher.set_map(grid)
    with pytest.raises(InputError, match="finite"):
        matcher.set_pose(Pose2D(math.nan, 0.0, 0.0), np.eye(3), 0.0)
    start = center(grid)
    matcher.set_pose(Pose2D(*start), np.eye(3) * 0.01, 0.0)
    scan = scan_from(grid, start, sensor=SENSOR)
    estimate = matcher.update(Transform2D(), scan, SENSOR)
    assert estimate is not None
    assert error(start, estimate)[0] < 0.1
