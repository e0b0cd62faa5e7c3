"""Lost or not, and finding the pose again."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from navstack.core import LaserScan, OccupancyGrid, ParameterError, Pose2D, Transform2D, angle_between
from navstack.localization.amcl import Amcl
from navstack.localization.global_search import FEWEST, Beams, continuity, scan_beams
from navstack.localization.searching import Agreement, LostDetector, SearchingLocalizer, is_sure
from navstack.parameters import AmclParams, LostParams, load_configuration
from tests.localization.rooms import free_pose, rooms, scan_from

SENSOR = Transform2D(0.1, 0.0, 0.0)
STEP = Transform2D(0.1, 0.0, 0.2)


@pytest.fixture(scope="module")
def grid() -> OccupancyGrid:
    return rooms(yaw=0.3)


def stamped(scan: LaserScan, t: float) -> LaserScan:
    return dataclasses.replace(scan, stamp=t)


def test_the_right_pose_is_never_lost_and_a_wrong_one_soon_is(grid: OccupancyGrid) -> None:
    detector = LostDetector(grid)
    rng = np.random.default_rng(1)
    truth = free_pose(grid, np.random.default_rng(4), margin=1.2)
    for k in range(50):
        found = detector.update(
            Pose2D(truth.x + rng.normal(0.0, 0.05), truth.y + rng.normal(0.0, 0.05), truth.yaw + rng.normal(0.0, 0.02)),
            stamped(scan_from(grid, truth, sensor=SENSOR), 0.2 * k),
            SENSOR,
        )
        assert found is not None
        assert not found.lost
        assert found.evidence < 0.5
        truth = truth @ STEP
    wrong = free_pose(grid, np.random.default_rng(9), margin=0.8)
    scan = scan_from(grid, truth, sensor=SENSOR)
    for k in range(50, 75):
        detector.update(Pose2D(*wrong), stamped(scan, 0.2 * k), SENSOR)
    found = detector.last
    assert found is not None
    assert found.lost
    assert found.since == pytest.approx(10.0, abs=1.0)
    assert found.text().startswith(f"lost since {found.since:.1f} s: ")
    for k in range(75, 100):  # and found again
        detector.update(Pose2D(*truth), stamped(scan, 0.2 * k), SENSOR)
    assert not detector.lost


def test_scans_that_do_not_count(grid: OccupancyGrid) -> None:
    detector = LostDetector(grid, LostParams(lost_interval=1.0))
    truth = free_pose(grid, np.random.default_rng(4), margin=1.2)
    scan = scan_from(grid, truth, sensor=SENSOR)
    first = detector.update(Pose2D(*truth), stamped(scan, 0.0), SENSOR)
    assert detector.update(Pose2D(*truth), stamped(scan, 0.5), SENSOR) is first
    nothing = dataclasses.replace(scan, ranges=np.full_like(scan.ranges, np.inf), stamp=2.0)
    assert detector.update(Pose2D(*truth), nothing, SENSOR) is first
    assert detector.update(Pose2D(math.nan, 0.0, 0.0), stamped(scan, 3.0), SENSOR) is first
    detector.reset()
    assert detector.last is None
    assert not detector.lost


def test_a_kidnapped_robot_notices_and_finds_itself(grid: OccupancyGrid) -> None:
    params = AmclParams(laser_max_beams=60, max_particles=1000, resample_interval=1, update_min_d=0.1, update_min_a=0.1)
    amcl = Amcl(params, seed=1)
    localizer = SearchingLocalizer(amcl)
    localizer.set_map(grid)
    truth = free_pose(grid, np.random.default_rng(4), margin=1.2)
    localizer.set_pose(Pose2D(*truth), np.diag([0.01, 0.01, 0.01]), math.inf)
    odometry = Transform2D()
    noticed = None
    for k in range(70):
        if noticed is not None and not localizer.lost:
            break  # later, the particles may lose themselves again in so tight a circle; what counts is that the pose is found
        if k == 20:
            truth = free_pose(grid, np.random.default_rng(21), margin=1.2)
        localizer.update(odometry, stamped(scan_from(grid, truth, sensor=SENSOR), 0.2 * k), SENSOR)
        if k < 20:
            assert not localizer.lost
        elif noticed is None and localizer.lost:
            noticed = k - 20
            status = localizer.status
            assert status.lost
            assert status.since == pytest.approx(0.2 * 20, abs=0.5)
            # the poses that explain the scan, the right one and the believed one among them, are all in the particles
            assert 1 < len(localizer.hypotheses) <= localizer.params.handed_hypotheses
            particles = amcl.particles.poses
            for pose, _, _ in localizer.hypotheses:
                assert np.hypot(particles[:, 0] - pose.x, particles[:, 1] - pose.y).min() < 0.3
            assert min(math.hypot(pose.x - truth.x, pose.y - truth.y) for pose, _, _ in localizer.hypotheses) < 0.2
        truth, odometry = truth @ STEP, odometry @ STEP
    assert noticed is not None
    assert noticed <= 25
    assert localizer.alarms[0].explained < 0.5
    estimate = localizer.estimate
    assert estimate is not None
    assert estimate.details["lost"] is False
    before = truth @ STEP.inverse()
    pose = estimate.map_to_odom @ odometry @ STEP.inverse()
    assert math.hypot(pose.x - before.x, pose.y - before.y) < 0.3
    assert not localizer.hypotheses


def test_a_global_start_hands_the_pose_to_the_particles(grid: OccupancyGrid) -> None:
    params = AmclParams(laser_max_beams=60, max_particles=1000, resample_interval=1, update_min_d=0.1, update_min_a=0.1)
    localizer = SearchingLocalizer(Amcl(params, seed=1))
    localizer.set_map(grid)
    localizer.start_globally()
    assert localizer.lost
    truth, odometry = free_pose(grid, np.random.default_rng(4), margin=1.2), Transform2D()
    for k in range(40):
        localizer.update(odometry, stamped(scan_from(grid, truth, sensor=SENSOR), 0.2 * k), SENSOR)
        truth, odometry = truth @ STEP, odometry @ STEP
    assert not localizer.lost
    assert len(localizer.jumps) == 1
    assert not localizer.alarms
    # in so tight a circle, random particles outweigh the true cluster once; the estimate does not follow them
    assert len(localizer.rejected) == 1
    assert localizer.agreement is not None
    assert localizer.agreement.explained > 0.9
    estimate = localizer.tracker.estimate
    assert estimate is not None
    assert estimate.details["particles"] > 50


def sparse_drive(grid: OccupancyGrid) -> list[tuple[Transform2D, Transform2D, LaserScan]]:
    """Pose, odometry and scan every 2 m of two rounds through a room; turns are measured a tenth too small."""
    frames: list[tuple[Transform2D, Transform2D, LaserScan]] = []
    truth, odometry = Transform2D(-1.2, 3.0, 0.0), Transform2D()
    for k in range(16):
        frames.append((truth, odometry, stamped(scan_from(grid, truth, sensor=SENSOR), 2.0 * k)))
        ahead, turn = ((2.2, math.pi / 2.0), (1.87, 0.0), (1.87, 0.0), (1.87, math.pi / 2.0))[k % 4]
        truth = truth @ Transform2D(ahead, 0.0, turn)
        odometry = odometry @ Transform2D(1.05 * ahead, 0.0, 0.9 * turn + 0.03 * ahead)
    return frames


def test_after_large_steps_the_estimate_is_right_or_not_certain() -> None:
    grid = rooms()
    localizer = SearchingLocalizer(Amcl(AmclParams(laser_max_beams=60), seed=1))
    localizer.set_map(grid)
    frames = sparse_drive(grid)
    localizer.set_pose(Pose2D(*frames[0][0]), np.diag([0.01, 0.01, 0.01]), math.inf)
    certain = 0
    for truth, odometry, scan in frames:
        localizer.update(odometry, scan, SENSOR)
        estimate = localizer.estimate
        assert estimate is not None
        pose = estimate.map_to_odom @ odometry
        off, turned = math.hypot(pose.x - truth.x, pose.y - truth.y), abs(angle_between(pose.yaw, truth.yaw))
        certain += is_sure(estimate)
        assert not is_sure(estimate) or (off < 0.3 and turned < 0.2)
    assert certain >= 12


def test_a_robot_that_stands_is_not_certain_once_a_scan_contradicts(grid: OccupancyGrid) -> None:
    localizer = SearchingLocalizer(Amcl(AmclParams(laser_max_beams=60), seed=1))
    localizer.set_map(grid)
    truth = free_pose(grid, np.random.default_rng(4), margin=1.2)
    localizer.set_pose(Pose2D(*truth), np.diag([0.01, 0.01, 0.01]), math.inf)
    free = scan_from(grid, truth, sensor=SENSOR)
    hidden = dataclasses.replace(free, ranges=np.where(np.arange(120) < 54, 0.5, free.ranges).astype(np.float32))
    certain: list[bool] = []
    for k, scan in enumerate((free, free, hidden)):
        localizer.update(Transform2D(), stamped(scan, 0.3 * k), SENSOR)
        estimate = localizer.estimate
        assert estimate is not None
        assert not localizer.lost
        certain.append(is_sure(estimate))
    assert certain == [True, True, False]


def test_a_scan_counts_again_after_a_new_pose(grid: OccupancyGrid) -> None:
    amcl = Amcl(AmclParams(laser_max_beams=60, resample_interval=1), seed=1)
    amcl.set_map(grid)
    truth = free_pose(grid, np.random.default_rng(4), margin=1.2)
    amcl.set_pose(Pose2D(*truth), np.diag([0.01, 0.01, 0.01]), math.inf)
    scan, ahead = scan_from(grid, truth, sensor=SENSOR), Transform2D(0.8, 0.0, 0.0)
    assert amcl.update(Transform2D(), scan, SENSOR) is not None
    assert amcl.update(Transform2D(), scan, SENSOR) is None
    assert len(amcl.rejections) == 1
    amcl.set_pose(Pose2D(*truth), np.diag([1e-4, 1e-4, 1e-4]), math.inf)
    assert amcl.update(Transform2D(), scan, SENSOR) is not None
    assert len(amcl.rejections) == 1
    # with the scan at the new pose, the motion up to the next one is known
    found = amcl.update(ahead, stamped(scan_from(grid, truth @ ahead, sensor=SENSOR), 1.0), SENSOR)
    assert found is not None
    assert math.hypot(found.pose.x - (truth @ ahead).x, found.pose.y - (truth @ ahead).y) < 0.15


def test_scans_that_follow_from_each_other(grid: OccupancyGrid) -> None:
    truth = free_pose(grid, np.random.default_rng(4), margin=1.2)
    beams = [scan_beams(scan_from(grid, pose, sensor=SENSOR), SENSOR) for pose in (truth, truth @ STEP)]
    agreeing = continuity(beams[0], beams[1], STEP)
    assert agreeing is not None
    assert agreeing > 0.95
    elsewhere = scan_beams(scan_from(grid, free_pose(grid, np.random.default_rng(21)), sensor=SENSOR), SENSOR)
    for other, step in ((elsewhere, STEP), (beams[1], Transform2D(0.0, 0.0, 1.5))):
        found = continuity(beams[0], other, step)
        assert found is not None
        assert found < 0.6
    nothing = Beams(np.empty((0, 3)), beams[0].eye)
    assert continuity(nothing, beams[1], STEP) is None
    assert continuity(beams[0], nothing, STEP) is None
    assert continuity(beams[0], beams[1].thinned(FEWEST - 1), STEP) is None


@pytest.mark.parametrize("carried_m", [0.0, 4.0])
def test_a_scan_that_does_not_follow_is_a_suspicion_that_the_map_decides(grid: OccupancyGrid, carried_m: float) -> None:
    detector = LostDetector(grid)
    truth = believed = free_pose(grid, np.random.default_rng(4), margin=1.2)
    odometry = Transform2D()
    results: list[Agreement] = []
    for k in range(40):
        if k == 10:
            odometry = odometry @ Transform2D(0.0, 0.0, 0.5)  # a wheel that slipped, or
            if carried_m:
                truth = free_pose(grid, np.random.default_rng(21), margin=1.2)
        scan = stamped(scan_from(grid, truth, sensor=SENSOR), 0.2 * k)
        result = detector.update(Pose2D(*believed), scan, SENSOR, odometry)
        assert result is not None
        results.append(result)
        truth, believed, odometry = truth @ STEP, believed @ STEP, odometry @ STEP
    assert results[0].continuous is None
    assert all(result.continuous is not None and result.continuous > 0.9 for result in results[1:10])
    assert not any(result.carried for result in results[:10])
    assert results[10].carried
    if carried_m:
        assert results[12].lost
        assert "after a scan that does not follow from the one before" in results[12].text()
    else:
        assert not any(result.lost for result in results)
        assert not results[-1].carried


def test_wrong_parameters_are_found_with_their_place(tmp_path: Path) -> None:
    file = tmp_path / "bad.yaml"
    lines = ["navstack: {lost_action: panic, lost_timeout: 0}", "supervision: {search: yes please}"]
    file.write_text("\n".join([*lines, "recovery_behaviors: [{name: it, type: spin_to_localise}]"]))
    with pytest.raises(ParameterError) as failed:
        load_configuration(["turtlebot", str(file)])
    text = str(failed.value)
    for part in ("bad.yaml:1:", "lost_action", "recover", "lost_timeout", "bad.yaml:2:", "search"):
        assert part in text
    assert 'did you mean "spin_to_localize"?' in text
    file.write_text("supervision: {lost_explained: 0.9}")
    with pytest.raises(ParameterError, match=r"lost_explained_then 0\.85 is below lost_explained 0\.9"):
        load_configuration(["turtlebot", str(file)])


def test_two_equal_rooms_are_both_in_the_particles_until_the_robot_has_seen_more() -> None:
    cells = np.zeros((60, 121), np.int8)
    cells[[0, -1]] = 100
    cells[:, [0, 60, 120]] = 100
    cells[20:26, 12:15] = 100
    cells[20:26, 72:75] = 100
    grid = OccupancyGrid.from_array(cells, 0.1, values="occupancy")
    amcl = Amcl(AmclParams(laser_max_beams=60, max_particles=2000), seed=1)
    localizer = SearchingLocalizer(amcl)
    localizer.set_map(grid)
    localizer.start_globally()
    truth, odometry = Transform2D(3.5, 3.5, 0.3), Transform2D()
    for k in range(12):
        localizer.update(odometry, stamped(scan_from(grid, truth, sensor=SENSOR), 0.2 * k), SENSOR)
        truth, odometry = truth @ STEP, odometry @ STEP
    assert localizer.lost
    assert localizer.status.text.startswith("the robot does not know yet where it started; 2 poses in the map explain")
    left = amcl.particles.weights[amcl.particles.poses[:, 0] < 6.0].sum()
    assert 0.2 < left < 0.8
    # the end of the right room is built over, on the map as well: what the robot sees now it can see from the left one only
    other = OccupancyGrid.from_array(
        np.where(np.arange(121) >= 100, 100, cells).astype(np.int8), 0.1, values="occupancy"
    )
    localizer.set_map(other)
    for k in range(12, 40):
        localizer.update(odometry, stamped(scan_from(other, truth, sensor=SENSOR), 0.2 * k), SENSOR)
        truth, odometry = truth @ STEP, odometry @ STEP
    assert not localizer.lost
    estimate = localizer.estimate
    assert estimate is not None
    before = truth @ STEP.inverse()
    pose = estimate.map_to_odom @ odometry @ STEP.inverse()
    assert math.hypot(pose.x - before.x, pose.y - before.y) < 0.3
