"""Inputs that no localizer may use: rejected with a reason, the state unharmed."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from navstack.core import InputError, LaserScan, OccupancyGrid, Pose2D, Transform2D
from navstack.localization.amcl import Amcl
from navstack.localization.scan_matcher import ScanMatcher
from navstack.localization.searching import SearchingLocalizer
from navstack.parameters import AmclParams
from tests.localization.rooms import free_pose, rooms, scan_from

SENSOR = Transform2D(0.1, 0.0, 0.0)
STEP = Transform2D(0.1, 0.0, 0.1)
GRID = rooms(yaw=0.3)
Input = tuple[Transform2D, LaserScan, Transform2D]

DEFECTS: dict[str, tuple[Callable[[Transform2D, LaserScan], Input], str]] = {
    "odometry NaN": (lambda o, s: (Transform2D(math.nan, 0.0, 0.0), s, SENSOR), "is not finite"),
    "odometry huge": (lambda o, s: (Transform2D(1e300, 0.0, 0.0), s, SENSOR), "is not a pose on earth"),
    "sensor NaN": (lambda o, s: (o, s, Transform2D(0.0, math.inf, 0.0)), "is not finite"),
    "stamp NaN": (lambda o, s: (o, dataclasses.replace(s, stamp=math.nan), SENSOR), "the stamp of the scan is nan"),
    "duplicate": (lambda o, s: (o, dataclasses.replace(s, stamp=s.stamp - 0.25), SENSOR), "is not newer than the last"),
    "out of order": (lambda o, s: (o, dataclasses.replace(s, stamp=s.stamp - 0.3), SENSOR), "is not newer than the"),
    "stale": (lambda o, s: (o, dataclasses.replace(s, stamp=s.stamp - 1e6), SENSOR), "is not newer than the last"),
    "range NaN": (lambda o, s: (o, dataclasses.replace(s, range_max=math.nan), SENSOR), "the limits of the scan are"),
    "angle NaN": (lambda o, s: (o, dataclasses.replace(s, angle_min=math.nan), SENSOR), "the angles of the scan are"),
}


def amcl() -> Amcl:
    return Amcl(AmclParams(laser_max_beams=30, max_particles=500, update_min_d=0.05), seed=1)


LOCALIZERS: dict[str, Callable[[], Any]] = {
    "amcl": amcl,
    "scan_matching": ScanMatcher,
    "supervised": lambda: SearchingLocalizer(amcl()),
}


def drive(localizer: Any, *, defective: bool, globally: bool) -> list[tuple[float, ...]]:
    """Drive a curve; with `defective`, every defect stands before each scan from the second one on."""
    localizer.set_map(GRID)
    truth, odometry = free_pose(GRID, np.random.default_rng(4), margin=1.2), Transform2D()
    if globally:
        localizer.start_globally()
    else:
        localizer.set_pose(Pose2D(*truth), np.diag([0.01, 0.01, 0.01]), math.inf)
    found: list[tuple[float, ...]] = []
    for k in range(12):
        scan = dataclasses.replace(scan_from(GRID, truth, sensor=SENSOR), stamp=0.25 * k)
        for make, _ in DEFECTS.values() if defective and k else ():
            assert localizer.update(*make(odometry, scan)) is None
        estimate = localizer.update(odometry, scan, SENSOR)
        if estimate is not None:
            found.append((*estimate.pose, *estimate.covariance.ravel().tolist(), *estimate.map_to_odom))
        truth, odometry = truth @ STEP, odometry @ STEP
    return found


@pytest.mark.slow
@pytest.mark.parametrize("globally", [False, True])
@pytest.mark.parametrize("name", LOCALIZERS)
def test_defective_inputs_are_rejected_and_change_nothing(name: str, globally: bool) -> None:
    clean, tried = LOCALIZERS[name](), LOCALIZERS[name]()
    assert drive(clean, defective=False, globally=globally) == drive(tried, defective=True, globally=globally)
    reasons = [reason for _, reason in tried.rejections][-len(DEFECTS) :]
    for (_, expected), reason in zip(DEFECTS.values(), reasons, strict=True):
        assert expected in reason
    assert not clean.rejections


@pytest.mark.parametrize("name", LOCALIZERS)
@pytest.mark.parametrize(
    ("pose", "covariance"),
    [
        (Pose2D(math.nan, 0.0, 0.0), np.eye(3)),
        (Pose2D(1e300, 0.0, 0.0), np.eye(3)),
        (Pose2D(0.0, 0.0, 0.0), np.full((3, 3), np.nan)),
        (Pose2D(0.0, 0.0, 0.0), -np.eye(3)),
        (Pose2D(0.0, 0.0, 0.0), np.eye(2)),
    ],
)
def test_initial_poses_that_are_none(name: str, pose: Pose2D, covariance: Any) -> None:
    localizer = LOCALIZERS[name]()
    localizer.set_map(GRID)
    with pytest.raises(InputError, match="initial pose"):
        localizer.set_pose(pose, covariance, 0.0)


def test_a_scan_without_a_valid_beam_does_not_move_the_pose() -> None:
    grid: OccupancyGrid = GRID
    truth = free_pose(grid, np.random.default_rng(4), margin=1.2)
    scan = scan_from(grid, truth, sensor=SENSOR)
    for make in LOCALIZERS.values():
        localizer = make()
        localizer.set_map(grid)
        localizer.set_pose(Pose2D(*truth), np.diag([1e-4, 1e-4, 1e-4]), math.inf)
        for k, ranges in enumerate((scan.ranges, np.full_like(scan.ranges, np.nan), -scan.ranges, scan.ranges[:0])):
            localizer.request_update()
            localizer.update(Transform2D(), dataclasses.replace(scan, ranges=ranges, stamp=0.2 * k), SENSOR)
        estimate = localizer.estimate
        assert estimate is not None
        assert math.hypot(estimate.pose.x - truth.x, estimate.pose.y - truth.y) < 0.1
