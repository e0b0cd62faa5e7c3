"""The odometry of wheels and inertial sensors through the extended Kalman filter."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from navstack.core import ImuReading, Pose2D, Transform2D, Twist2D
from navstack.interfaces import OdometryFilter
from navstack.localization.ekf.ekf import Ekf
from navstack.parameters.models.ekf import FilterParams

WHEELS: Final = np.diag([4e-4, 1e-6, 1e-2])
"""Covariance of the wheels' velocities: 0.02 m/s, no sideways motion, 0.1 rad/s."""
POSE: Final = np.diag([1e-2, 1e-2, 1e-2])
GYRO: Final = 1e-5
"""Variance of the yaw rate (rad²/s²)."""
COMPASS: Final = 1e-3
"""Variance of the yaw (rad²)."""


class FilteredOdometry(OdometryFilter):
    """Feeds `Ekf` with the wheels' velocities as `odom0` and inertial readings as `imu0`, if they are configured."""

    def __init__(self, params: FilterParams) -> None:
        self.ekf = Ekf(params)
        sources = params.sources()
        self._wheels, self._imu = "odom0" in sources, "imu0" in sources
        self._last: tuple[float, Transform2D] | None = None

    def start(self, stamp: float, pose: Transform2D) -> None:
        """Begin at a pose of the wheels' odometry."""
        self._last = stamp, pose
        self.ekf.set_pose(Pose2D(*pose), np.diag([1e-9, 1e-9, 1e-9]), stamp)

    def run(
        self, wheels: Sequence[Transform2D], stamps: Sequence[float], readings: Sequence[ImuReading]
    ) -> list[Transform2D]:
        """Return the filtered poses at `stamps` (s); see `OdometryFilter.run`."""
        waiting = sorted(readings, key=lambda reading: reading.stamp)
        position = 0
        found: list[Transform2D] = []
        for stamp, pose in zip(stamps, wheels, strict=True):
            while position < len(waiting) and waiting[position].stamp <= stamp:
                self._add_reading(waiting[position])
                position += 1
            self._add_wheels(stamp, pose)
            state, _ = self.ekf.predicted(stamp)
            found.append(Transform2D(*state[:3].tolist()))
        return found

    @property
    def twist(self) -> Twist2D:
        """Filtered velocity in the base frame."""
        return self.ekf.twist

    def _add_wheels(self, stamp: float, pose: Transform2D) -> None:
        if self._last is None:
            self.start(stamp, pose)
            return
        before, last = self._last
        self._last = stamp, pose
        dt = stamp - before
        if not self._wheels or dt <= 0.0:
            return
        motion = last.inverse() @ pose
        twist = Twist2D(motion.x / dt, motion.y / dt, motion.yaw / dt)
        self.ekf.add_odometry("odom0", stamp, Pose2D(*pose), POSE, twist, WHEELS)

    def _add_reading(self, reading: ImuReading) -> None:
        if self._imu and self._last is not None:
            self.ekf.add_imu("imu0", reading.stamp, (reading.yaw, COMPASS), (reading.yaw_rate, GYRO))
