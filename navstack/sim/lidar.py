"""A planar range finder: exact ranges, with noise that depends only on the seed and the number of the scan."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from navstack.core import DeferredScan, LaserScan, Pose2D, Transform2D
from navstack.parameters.models.sim import LidarParams
from navstack.sim._lidar_kernels import SCAN, sweep
from navstack.sim.solids import Solids
from navstack.sim.world import World


def scan_settings(
    height: float, angle_min: float, angle_increment: float, range_min: float, range_max: float
) -> NDArray[np.void]:
    """Returns the settings of a scan (m, rad) as an array (1,) of type `SCAN`."""
    return np.array([(height, angle_min, angle_increment, range_min, range_max)], SCAN)


class Lidar:
    """Computes scans of a world from poses of the robot."""

    def __init__(self, params: LidarParams, *, seed: int, number: int) -> None:
        """`number` distinguishes the lidars of a robot: each has its own random stream."""
        self.params = params
        self.mounting = Transform2D(params.x, params.y, params.yaw)
        angles = params.angle_min + params.angle_increment * np.arange(params.beams)
        self._beams: NDArray[np.float64] = np.column_stack((np.cos(angles), np.sin(angles)))
        self._settings = scan_settings(
            params.height, params.angle_min, params.angle_increment, params.range_min, params.range_max
        )
        self._angle_min, self._angle_increment = params.angle_min, params.angle_increment
        self._no_noise = np.empty((0, params.beams))
        self._noisy = params.range_noise > 0.0 or params.dropout > 0.0
        self._seed = seed
        self._number = number

    def scan(self, world: World, base: Pose2D, index: int, stamp: float, solids: Solids | None = None) -> LaserScan:
        """Returns scan number `index`, with the robot's base at `base` (map frame) at `stamp` (s).

        `solids`: the obstacles at that time, if known. A pure function of its arguments and the seed: scans are independent of
        each other, and the ranges are computed when they are first read.
        """
        p = self.params
        solids_then = world.solids_at(stamp) if solids is None else solids
        return DeferredScan(
            lambda: self._ranges(world, base, index, solids_then),
            self._angle_min,
            self._angle_increment,
            p.range_min,
            p.range_max,
            stamp,
            p.frame,
            p.topic,
            p.height,
        )

    def _ranges(self, world: World, base: Pose2D, index: int, solids: Solids) -> NDArray[np.float32]:
        p = self.params
        eye = tuple(Transform2D(base.x, base.y, base.yaw) @ self.mounting)
        noise = self._noise(index) if self._noisy else self._no_noise
        ranges = sweep(world.leaps, world.grid, *solids, eye, self._beams, self._settings, noise)
        if p.no_return == "max":
            ranges[np.isposinf(ranges)] = p.range_max
        return ranges

    def _noise(self, index: int) -> NDArray[np.float64]:
        """Returns the noise of scan number `index`, as `sweep` takes it."""
        p = self.params
        rng = np.random.Generator(np.random.PCG64([self._seed, 1 + self._number, index]))
        noise = np.zeros((2 if p.dropout > 0.0 else 1, p.beams))
        if p.range_noise > 0.0:
            noise[0] = p.range_noise * rng.standard_normal(p.beams)
        if p.dropout > 0.0:
            noise[1] = rng.random(p.beams) >= p.dropout
        return noise
