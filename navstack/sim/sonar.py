"""A sonar or infrared sensor: the nearest thing in a cone."""

from __future__ import annotations

import math

import numpy as np

from navstack.core import Pose2D, RangeReading, Transform2D
from navstack.parameters.models.sim import SonarParams
from navstack.sim._lidar_kernels import sweep
from navstack.sim.solids import Solids
from navstack.sim.world import World

_NO_NOISE = np.empty(0)
_NO_LOSS = np.empty(0, np.bool_)


class Sonar:
    """Makes readings of a world from poses of the robot."""

    def __init__(self, params: SonarParams, *, seed: int, number: int) -> None:
        """`number` tells the sonars of one robot apart: each draws from a stream of its own."""
        self.params = params
        self.mounting = Transform2D(params.x, params.y, params.yaw)
        self._increment = params.fov / max(params.beams - 1, 1)
        self._angle_min = -0.5 * self._increment * (params.beams - 1)
        angles = self._angle_min + self._increment * np.arange(params.beams)
        self._beams = np.column_stack((np.cos(angles), np.sin(angles)))
        self._stream = [seed, (1 << 21) + number]

    def scan(self, world: World, base: Pose2D, index: int, stamp: float, solids: Solids | None = None) -> RangeReading:
        """Reading number `index`, taken with the robot's base at `base` (map frame) at `stamp` (s).

        `solids`: the world's obstacles at that time, when the caller knows them already. A pure function of its arguments
        and the seed.
        """
        p = self.params
        eye = Transform2D(base.x, base.y, base.yaw) @ self.mounting
        noise, missed = 0.0, False
        if p.range_noise > 0.0 or p.dropout > 0.0:
            rng = np.random.Generator(np.random.PCG64([*self._stream, index]))
            noise = p.range_noise * float(rng.standard_normal())
            missed = float(rng.random()) < p.dropout
        nearest = math.inf
        if not missed:
            ranges = sweep(
                world.leaps,
                world.grid,
                *(world.solids_at(stamp) if solids is None else solids),
                eye.x,
                eye.y,
                eye.yaw,
                p.height,
                self._beams,
                self._angle_min,
                self._increment,
                0.0,
                # a hit just beyond may be measured within
                p.range_max + max(-noise, 0.0),
                _NO_NOISE,
                _NO_LOSS,
            )
            nearest = max(float(ranges.min()) + noise, p.range_min)
        if nearest >= p.range_max:
            nearest = p.range_max if p.no_return == "max" else math.inf
        return RangeReading(nearest, p.fov, p.range_min, p.range_max, stamp, p.frame, p.topic)
