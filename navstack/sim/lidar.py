"""A planar range finder: exact ranges, noise that depends on the seed and the number of the scan alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from navstack.core import DeferredScan, LaserScan, Pose2D, Transform2D
from navstack.parameters.models.sim import LidarParams
from navstack.sim._lidar_kernels import sweep
from navstack.sim.solids import Solids
from navstack.sim.world import World

_NO_NOISE = np.empty(0)
_NO_LOSS = np.empty(0, np.bool_)


class Lidar:
    """Makes scans of a world from poses of the robot."""

    def __init__(self, params: LidarParams, *, seed: int, number: int) -> None:
        """`number` tells the lidars of one robot apart: each draws from a stream of its own."""
        self.params = params
        self.mounting = Transform2D(params.x, params.y, params.yaw)
        angles = params.angle_min + params.angle_increment * np.arange(params.beams)
        self._beams: NDArray[np.float64] = np.column_stack((np.cos(angles), np.sin(angles)))
        self._angle_min, self._angle_increment = params.angle_min, params.angle_increment
        self._noisy = params.range_noise > 0.0 or params.dropout > 0.0
        self._seed = seed
        self._number = number

    def scan(self, world: World, base: Pose2D, index: int, stamp: float, solids: Solids | None = None) -> LaserScan:
        """Scan number `index`, taken with the robot's base at `base` (map frame) at `stamp` (s).

        `solids`: the world's obstacles at that time, when the caller knows them already. A pure function of its arguments
        and the seed: a scan that nobody asked for changes no other, and one that nobody reads is not cast.
        """
        p = self.params
        there = world.solids_at(stamp) if solids is None else solids
        return DeferredScan(
            lambda: self._ranges(world, base, index, there),
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
        eye = Transform2D(base.x, base.y, base.yaw) @ self.mounting
        noise, kept = _NO_NOISE, _NO_LOSS
        if self._noisy:
            rng = np.random.Generator(np.random.PCG64([self._seed, 1 + self._number, index]))
            if p.range_noise > 0.0:
                noise = p.range_noise * rng.standard_normal(p.beams)
            if p.dropout > 0.0:
                kept = rng.random(p.beams) >= p.dropout
        ranges = sweep(
            world.leaps,
            world.grid,
            *solids,
            eye.x,
            eye.y,
            eye.yaw,
            p.height,
            self._beams,
            self._angle_min,
            self._angle_increment,
            p.range_min,
            p.range_max,
            noise,
            kept,
        )
        if p.no_return == "max":
            ranges[np.isposinf(ranges)] = p.range_max
        return ranges
