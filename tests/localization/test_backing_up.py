"""Odometry that reports forward while the robot backs up: no localizer follows that, but each of them finds the pose again."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from navstack.core import OccupancyGrid, Pose2D, Transform2D
from navstack.localization import LoggedScan
from navstack.localization.evaluation import follow
from navstack.localization.methods import UNSEARCHED, Method, methods
from navstack.localization.scan_matcher import ScanMatcher
from navstack.localization.searching import LostDetector, SearchingLocalizer
from navstack.parameters import ScanMatcherParams
from tests.localization.rooms import free_pose, rooms, scan_from

SENSOR = Transform2D(0.1, 0.0, 0.0)
SPEED, STEP_S = 0.12, 0.2
"""m per scan, s."""


def backing_log(grid: OccupancyGrid, seed: int, scans: int, *, wrong_share: float = 0.6) -> list[LoggedScan]:
    """A drive with many short ways backwards, of which the odometry reports 3 in 5 as ways forward."""
    rng = np.random.default_rng(seed)
    room = np.asarray(distance_transform_edt(grid.data != 100)) * grid.geometry.resolution
    at, odometry = free_pose(grid, rng, margin=1.0), Transform2D()
    found: list[LoggedScan] = []
    backwards, wrong = 0, False
    for k in range(scans):
        scan = scan_from(grid, at, sensor=SENSOR)
        ranges = (scan.ranges + rng.normal(0.0, 0.01, len(scan.ranges))).astype(np.float32)
        scan = dataclasses.replace(scan, ranges=ranges, stamp=STEP_S * k)
        found.append(LoggedScan(k, scan, SENSOR, odometry, Pose2D(*at)))
        if backwards == 0 and rng.random() < 0.04:
            backwards, wrong = int(rng.integers(5, 15)), rng.random() < wrong_share
        v, w = (-SPEED if backwards else SPEED), float(rng.normal(0.0, 0.05))
        after = at @ Transform2D(v, 0.0, w)
        cell = grid.geometry.world_to_cell(after.x, after.y)
        if cell is None or room[cell[1], cell[0]] < 0.45:
            v, w = 0.0, 0.3
            after = at @ Transform2D(0.0, 0.0, w)
        odometry = odometry @ Transform2D(abs(v) if backwards and wrong else v, 0.0, 1.02 * w)
        at, backwards = after, max(0, backwards - 1)
    return found


def errors(log: list[LoggedScan], method: Method, grid: OccupancyGrid) -> NDArray[np.float64]:
    localizer, _ = method.build(0)
    localizer.set_map(grid)
    track = follow(iter(log), localizer)
    return np.hypot(*(track.poses[:, :2] - track.references[:, :2]).T)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 5])
def test_a_lost_robot_finds_itself_by_default(seed: int) -> None:
    grid = rooms()
    log = backing_log(grid, seed, 500)
    alone = errors(log, Method(values={"search": False}), grid)
    assert alone[-100:].min() > 2.0
    for method in (Method(), Method("amcl")):
        found = errors(log, method, grid)
        assert found[-1] < 0.2, method.label
        assert np.median(found) < 0.3, method.label
        assert float(np.sqrt(np.square(found).mean())) < 1.0, method.label


@pytest.mark.parametrize("name", methods())
def test_every_method_recovers_or_says_that_it_is_lost(name: str) -> None:
    """Given a wrong pose, no method stays sure of it; those that search find the right one."""
    grid = rooms()
    log = backing_log(grid, 0, 60, wrong_share=0.0)
    localizer, _ = Method(name).build(0)
    assert isinstance(localizer, SearchingLocalizer)
    localizer.set_map(grid)
    wrong = free_pose(grid, np.random.default_rng(9), margin=0.8)
    track = follow(iter(log), localizer, initial_pose=Pose2D(*wrong))
    assert track.errors[0] > 1.0
    assert not (track.sure & (track.errors > 0.5))[15:].any()
    if name not in UNSEARCHED:
        assert not track.lost[-1]
        assert track.errors[-1] < 0.3


def test_watching_changes_no_estimate() -> None:
    grid = rooms()
    log = backing_log(grid, 0, 60)
    watched, _ = Method("scan_matching", {"search": False, "match_beams": 30}).build(0)
    alone = ScanMatcher(ScanMatcherParams(match_beams=30))
    for localizer in (watched, alone):
        localizer.set_map(grid)
    one, other = follow(iter(log), watched), follow(iter(log), alone)
    assert np.array_equal(one.poses, other.poses)


def test_a_start_without_a_pose_is_lost_until_the_particles_agree() -> None:
    grid = rooms()
    localizer, _ = Method("amcl_only", {"max_particles": 500}).build(0)
    localizer.set_map(grid)
    track = follow(iter(backing_log(grid, 0, 3)), localizer, globally=True)
    assert track.lost.all()
    assert localizer.status is not None and "does not know yet where it started" in localizer.status.text


def test_a_pose_beyond_the_map_explains_nothing() -> None:
    """A wall at the border of the map is no wall everywhere beyond it."""
    grid = rooms()
    scan = scan_from(grid, Transform2D(1.0, 4.5, 0.2), sensor=SENSOR)
    detector = LostDetector(grid)
    assert detector.explained_at(Pose2D(1.0, 4.5, 0.2), scan, SENSOR) > 0.95
    for x, y in ((1.0, 25.0), (1.0, -20.0), (-30.0, 4.5), (40.0, 4.5)):
        assert detector.explained_at(Pose2D(x, y, 0.2), scan, SENSOR) < 0.05
