"""An inertial measurement unit that moves in the plane: yaw and its rate, with noise, bias and drift."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import Final

import numpy as np

from navstack.core import ImuReading, Transform2D, normalize_angle
from navstack.parameters.models.sim import ImuParams

KEPT: Final = 10_000
"""So many readings that nobody has fetched are kept; older ones are forgotten."""


class Imu:
    """Makes readings from the robot's true yaw, in the order of time.

    Its rate is wrong by noise and by a bias, which is constant but for a random walk; its yaw is wrong by the sum of that
    bias over time, as a gyroscope's is, and by noise. At the start it knows its yaw.
    """

    def __init__(self, params: ImuParams, *, seed: int, number: int) -> None:
        """`number` tells the IMUs of one robot apart: each draws from a stream of its own."""
        self.params = params
        self.mounting = Transform2D(params.x, params.y, params.yaw)
        self._rng = np.random.Generator(np.random.PCG64([seed, (1 << 22) + number]))
        self._bias = params.yaw_rate_bias
        self._drift = 0.0
        self._last = 0.0
        self._readings: deque[ImuReading] = deque(maxlen=KEPT)

    def feel(self, yaw: float, yaw_rate: float, stamp: float) -> None:
        """Measures a base with that yaw (rad, in the map) and rate (rad/s), both true, at `stamp` (s)."""
        p = self.params
        passed = stamp - self._last
        self._last = stamp
        noise = self._rng.standard_normal(3).tolist()
        self._bias += p.yaw_rate_drift * math.sqrt(passed) * noise[0]
        self._drift += self._bias * passed
        half = 0.5 * normalize_angle(yaw + p.yaw + self._drift + p.orientation_noise * noise[1])
        self._readings.append(
            ImuReading(
                orientation=(0.0, 0.0, math.sin(half), math.cos(half)),
                yaw_rate=yaw_rate + self._bias + p.yaw_rate_noise * noise[2],
                stamp=stamp,
                frame=p.frame,
                topic=p.topic,
            )
        )

    def fetch(self) -> Sequence[ImuReading]:
        """The readings since the last call, oldest first."""
        readings = list(self._readings)
        self._readings.clear()
        return readings
