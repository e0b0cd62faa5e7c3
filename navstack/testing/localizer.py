"""The contract of localizers."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, Final

import numpy as np
import pytest

from navstack.core import GridGeometry, LaserScan, NavError, OccupancyGrid, Pose2D, Transform2D
from navstack.plugins import Localizer, PoseEstimate
from navstack.testing.base import Contract, contract_of

SENSOR: Final = Transform2D(0.1, 0.0, 0.0)
COVARIANCE: Final = np.diag([0.04, 0.04, 0.01])
NEAR_M: Final = 0.4
"""A localizer that starts near the true pose stays within this distance of it."""
_ROOM: Final = """
##############################
#.......#....................#
#.......#....................#
#.......#..........####......#
#..................####......#
#............................#
#.......#....................#
#.......#....................#
#########...........#........#
#...................#........#
#...................#........#
#....##.............#####....#
#....##......................#
#............................#
#...................#........#
#...................#........#
##############################
"""
_BEAMS: Final = 90


def room() -> OccupancyGrid:
    """A room of 7.5 x 4.25 m, cells of 0.25 m, that looks different from every place."""
    rows = _ROOM.split()[::-1]
    cells = np.array([[100 if c == "#" else 0 for c in row] for row in rows], np.int8)
    return OccupancyGrid(cells, GridGeometry(cells.shape[1], cells.shape[0], 0.25, -1.0, -0.5))


def scan_at(grid: OccupancyGrid, base: Transform2D, stamp: float) -> LaserScan:
    """The scan of the full circle with the base at a pose in the map."""
    g = grid.geometry
    increment = 2.0 * math.pi / _BEAMS
    eye = base @ SENSOR
    angles = eye.yaw - math.pi + increment * np.arange(_BEAMS)
    along = np.arange(0.0, 9.0, 0.02)
    x = eye.x + np.cos(angles)[:, None] * along
    y = eye.y + np.sin(angles)[:, None] * along
    ix = np.clip(((x - g.origin_x) / g.resolution).astype(int), 0, g.nx - 1)
    iy = np.clip(((y - g.origin_y) / g.resolution).astype(int), 0, g.ny - 1)
    hit = grid.data[iy, ix] == 100
    ranges = np.where(hit.any(axis=1), along[hit.argmax(axis=1)], np.inf).astype(np.float32)
    return LaserScan(ranges, -math.pi, increment, 0.05, 9.0, stamp, "laser", "scan")


class LocalizerContract(Contract):
    """What every localizer must do. Constructor: `(params, *, seed)`."""

    def make(self, seed: int = 1) -> Localizer:
        """The localizer, with the room's map."""
        localizer: Localizer = self.plugin(self.params(), seed=seed)
        localizer.set_map(room())
        return localizer

    @staticmethod
    def drive(count: int = 24) -> list[tuple[Transform2D, Transform2D]]:
        """True poses in the map, and the poses of the odometry, which starts elsewhere and turns by 1 % too much."""
        true, odometry = [Transform2D(3.0, 1.0, 0.2)], [Transform2D(-5.0, 2.0, 1.0)]
        for _ in range(count - 1):
            true.append(true[-1] @ Transform2D(0.12, 0.0, 0.09))
            odometry.append(odometry[-1] @ Transform2D(0.12, 0.0, 0.0909))
        return list(zip(true, odometry, strict=True))

    def run(self, localizer: Localizer, *, first: int = 0) -> list[PoseEstimate | None]:
        """Start at the true pose and drive; the estimates after each scan."""
        steps = self.drive()
        localizer.set_pose(Pose2D(*steps[first][0]), COVARIANCE, math.inf)
        found: list[PoseEstimate | None] = []
        for k, (true, odometry) in enumerate(steps[first:], start=first):
            localizer.update(odometry, scan_at(room(), true, 0.5 * k), SENSOR)
            found.append(localizer.estimate)
        return found

    def off(self, estimate: PoseEstimate | None, step: int = -1) -> float:
        """Distance (m) of an estimate from the true pose."""
        assert estimate is not None
        true, odometry = self.drive()[step]
        here = estimate.map_to_odom @ odometry
        return math.hypot(here.x - true.x, here.y - true.y)

    @staticmethod
    def same(a: PoseEstimate | None, b: PoseEstimate | None) -> bool:
        """Whether two estimates are equal to the bit."""
        if a is None or b is None:
            return a is b
        return (a.pose, a.map_to_odom, a.stamp) == (b.pose, b.map_to_odom, b.stamp) and np.array_equal(
            a.covariance, b.covariance
        )

    def test_it_follows_a_known_start(self) -> None:
        """Estimates are finite, with a covariance that is one, and stay near the true pose."""
        localizer = self.make()
        for estimate in self.run(localizer):
            assert estimate is not None
            assert estimate.pose.is_finite()
            assert all(map(math.isfinite, estimate.map_to_odom))
            matrix = estimate.covariance
            assert matrix.shape == (3, 3)
            assert np.allclose(matrix, matrix.T, atol=1e-12)
            assert np.linalg.eigvalsh(matrix)[0] > -1e-9
        assert self.off(localizer.estimate) < NEAR_M

    def test_equal_inputs_and_seeds_give_equal_estimates(self) -> None:
        """Nothing is drawn from anywhere but the seed."""
        first, second = self.run(self.make(seed=3)), self.run(self.make(seed=3))
        assert all(self.same(a, b) for a, b in zip(first, second, strict=True))

    def test_defective_input_leaves_the_state_unharmed(self) -> None:
        """What is not finite, or older than the last scan, is refused: the estimates are those without it."""
        clean, disturbed = self.make(), self.make()
        steps = self.drive()
        for localizer in (clean, disturbed):
            localizer.set_pose(Pose2D(*steps[0][0]), COVARIANCE, math.inf)
        nan, inf = math.nan, math.inf
        for k, (true, odometry) in enumerate(steps):
            scan = scan_at(room(), true, 0.5 * k)
            clean.update(odometry, scan, SENSOR)
            if k > 2:
                far = odometry @ Transform2D(2.0, 1.0, 1.0)
                for bad_odometry, bad_scan, bad_sensor in (
                    (Transform2D(nan, 0.0, 0.0), scan, SENSOR),
                    (Transform2D(0.0, inf, 0.0), scan, SENSOR),
                    (odometry, dataclasses.replace(scan, stamp=nan), SENSOR),
                    (far, dataclasses.replace(scan, stamp=0.5 * k - 2.0), SENSOR),
                ):
                    try:
                        disturbed.update(bad_odometry, bad_scan, bad_sensor)
                    except NavError:
                        continue
            disturbed.update(odometry, scan, SENSOR)
            assert self.same(clean.estimate, disturbed.estimate), f"scan {k}"

    def test_a_scan_without_a_return_is_harmless(self) -> None:
        """A covered sensor: NaN, nothing in reach, or only zeros."""
        localizer = self.make()
        self.run(localizer)
        _, odometry = self.drive()[-1]
        for i, value in enumerate((math.nan, math.inf, 0.0)):
            blind = scan_at(room(), self.drive()[-1][0], 100.0 + i)
            blind = dataclasses.replace(blind, ranges=np.full(_BEAMS, value, np.float32))
            localizer.request_update()
            localizer.update(odometry, blind, SENSOR)
            assert self.off(localizer.estimate) < NEAR_M

    def test_a_pose_that_is_none_is_refused(self) -> None:
        """An initial pose that is not finite is an error, and the estimate goes on."""
        localizer = self.make()
        self.run(localizer)
        before = localizer.estimate
        for pose, covariance in (
            (Pose2D(math.nan, 0.0, 0.0), COVARIANCE),
            (Pose2D(0.0, 0.0, 0.0), np.full((3, 3), math.inf)),
        ):
            with pytest.raises(NavError):
                localizer.set_pose(pose, covariance, math.inf)
        assert self.same(localizer.estimate, before)

    def test_it_starts_again(self) -> None:
        """A new pose replaces everything that was known, also after a global start."""
        localizer = self.make()
        self.run(localizer)
        localizer.start_globally()
        true, odometry = self.drive()[0]
        localizer.update(odometry, scan_at(room(), true, 200.0), SENSOR)
        estimate = localizer.estimate
        assert estimate is None or estimate.pose.is_finite()
        again = self.plugin(self.params(), seed=1)
        again.set_map(room())
        self.run(again, first=0)
        assert self.off(again.estimate) < NEAR_M
        localizer.set_pose(Pose2D(*true), COVARIANCE, math.inf)
        localizer.update(odometry, scan_at(room(), true, 201.0), SENSOR)
        assert self.off(localizer.estimate, 0) < NEAR_M

    def test_a_new_map_keeps_the_estimate(self) -> None:
        """The map is published again while the robot stands."""
        localizer = self.make()
        self.run(localizer)
        localizer.set_map(room())
        true, odometry = self.drive()[-1]
        localizer.update(odometry, scan_at(room(), true, 300.0), SENSOR)
        assert self.off(localizer.estimate) < NEAR_M

    def test_the_possible_poses(self) -> None:
        """Finite poses with weights that sum to one."""
        localizer = self.make()
        self.run(localizer)
        poses, weights = localizer.possible_poses()
        assert poses.shape == (len(weights), 3)
        assert len(weights) > 0
        assert np.isfinite(poses).all()
        assert (weights >= 0.0).all()
        assert weights.sum() == pytest.approx(1.0, abs=1e-6)


def localizer_contract(plugin: type[Localizer], **values: Any) -> type[LocalizerContract]:
    """The suite for a localizer, with these parameter values."""
    return contract_of(LocalizerContract, plugin, values)
