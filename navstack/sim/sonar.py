"""A sonar or infrared sensor: the distance to the nearest obstacle in a cone."""

from __future__ import annotations

import math

import numpy as np

from navstack.core import Pose2D, RangeReading, Transform2D
from navstack.parameters.models.sim import SonarParams
from navstack.sim._lidar_kernels import sweep
from navstack.sim.lidar import scan_settings
from navstack.sim.solids import Solids
from navstack.sim.world import World


class Sonar:
    """Computes readings of a world from poses of the robot."""

    def __init__(self, params: SonarParams, *, seed: int, number: int) -> None:
        """`number` distinguishes the sonars of a robot: each has its own random stream."""
        self.params = params
        self.mounting = Transform2D(params.x, params.y, params.yaw)
        self._increment = params.fov / max(params.beams - 1, 1)
        self._angle_min = -0.5 * self._increment * (params.beams - 1)
        angles = self._angle_min + self._increment * np.arange(params.beams)
        self._beams = np.column_stack((np.cos(angles), np.sin(angles)))
        self._no_noise = np.empty((0, params.beams))
        self._stream = [seed, (1 << 21) + number]

    def scan(self, world: World, base: Pose2D, index: int, stamp: float, solids: Solids | None = None) -> RangeReading:
        """Returns reading number `index`, with the robot's base at `base` (map frame) at `stamp` (s).

        `solids`: the obstacles at that time, if known. A pure function of its arguments and the seed.
        """
        p = self.params
        noise, missed = 0.0, False
        if p.range_noise > 0.0 or p.dropout > 0.0:
            rng = np.random.Generator(np.random.PCG64([*self._stream, index]))
            noise = p.range_noise * float(rng.standard_normal())
            missed = float(rng.random()) < p.dropout
        nearest = math.inf
        if not missed:
            # noise can bring a hit just beyond into the range
            reach = p.range_max + max(-noise, 0.0)
            settings = scan_settings(p.height, self._angle_min, self._increment, 0.0, reach)
            eye = tuple(Transform2D(base.x, base.y, base.yaw) @ self.mounting)
            there = world.solids_at(stamp) if solids is None else solids
            ranges = sweep(world.leaps, world.grid, *there, eye, self._beams, settings, self._no_noise)
            nearest = max(float(ranges.min()) + noise, p.range_min)
        nearest = float(np.float32(nearest))  # the precision of sensor_msgs/Range; limits are exact
        if nearest <= np.float32(p.range_min):
            nearest = p.range_min
        if nearest >= np.float32(p.range_max):
            nearest = p.range_max if p.no_return == "max" else math.inf
        return RangeReading(nearest, p.fov, p.range_min, p.range_max, stamp, p.frame, p.topic)
