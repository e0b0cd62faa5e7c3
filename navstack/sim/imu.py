"""An inertial measurement unit that moves in the plane: yaw and yaw rate, with noise, bias and drift."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import Final

import numpy as np

from navstack.core import ImuReading, Transform2D, normalize_angle
from navstack.parameters import ImuParams

MAX_READINGS: Final = 10_000
"""Maximum number of readings that wait to be fetched; the oldest are dropped."""


class Imu:
    """Computes readings from the robot's true yaw, in the order of time.

    The errors of the rate are noise and a bias, which is constant except for a random walk; the errors of the yaw are the
    integrated bias, as for a gyroscope, and noise. The initial yaw is exact.
    """

    def __init__(self, params: ImuParams, *, seed: int, number: int) -> None:
        """`number` distinguishes the IMUs of a robot: each has its own random stream."""
        self.params = params
        self.mounting = Transform2D(params.x, params.y, params.yaw)
        self._rng = np.random.Generator(np.random.PCG64([seed, (1 << 22) + number]))
        self._bias = params.yaw_rate_bias
        self._drift = 0.0
        self._last = 0.0
        self._readings: deque[ImuReading] = deque(maxlen=MAX_READINGS)

    def measure(self, yaw: float, yaw_rate: float, stamp: float) -> None:
        """Measures a base with the true yaw (rad, in the map) and yaw rate (rad/s) at `stamp` (s)."""
        p = self.params
        elapsed = stamp - self._last
        self._last = stamp
        noise = self._rng.standard_normal(3).tolist()
        self._bias += p.yaw_rate_drift * math.sqrt(elapsed) * noise[0]
        self._drift += self._bias * elapsed
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
        """Returns the readings since the last call, oldest first."""
        readings = list(self._readings)
        self._readings.clear()
        return readings
