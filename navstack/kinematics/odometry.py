"""Odometry: a pose from the motion of the wheels, integrated exactly, by Euler's or by the second-order Runge-Kutta method."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from navstack.core import Pose2D, Twist2D, normalize_angle
from navstack.core.errors import InputError
from navstack.kinematics.drives import WheelDrive

Method = Literal["exact", "euler", "rk2"]
METHODS: Final[tuple[Method, ...]] = get_args(Method)
"""`exact`: along the arc; `rk2`: along the heading at half of the step; `euler`: along the heading at its start."""


def integrate(pose: Pose2D, twist: Twist2D, dt: float, method: Method = "exact") -> Pose2D:
    """Return the pose after `dt` (s) at a constant velocity of the base.

    With a = wz dt: `exact` moves by the chord of the arc, sin(a / 2) / (a / 2) of its length, along yaw + a / 2. `rk2` (the
    midpoint rule) moves by the whole length in the same direction: its error is a² / 24 of the length. `euler` moves along yaw:
    its error is a / 2 of the length.
    """
    turn = twist.wz * dt
    half = 0.5 * turn
    heading, scale = pose.yaw + half, dt
    if method == "euler":
        heading = pose.yaw
    elif method == "exact" and half != 0.0:
        scale = dt * math.sin(half) / half
    c, s = math.cos(heading), math.sin(heading)
    x = pose.x + scale * (c * twist.vx - s * twist.vy)
    y = pose.y + scale * (s * twist.vx + c * twist.vy)
    return Pose2D(x, y, normalize_angle(pose.yaw + turn))


class WheelOdometry:
    """The pose and velocity of a base from the counts of its wheel encoders.

    Its error is at most one tick per wheel for any number of updates, plus slip: counts are totals, so that no
    rounding adds up.
    """

    def __init__(
        self,
        drive: WheelDrive,
        metres_per_tick: float,
        start: Pose2D = Pose2D(0.0, 0.0),
        method: Method = "exact",
    ) -> None:
        """`metres_per_tick`: 2 pi wheel radius / ticks per revolution. Raises InputError."""
        if not (math.isfinite(metres_per_tick) and metres_per_tick > 0.0):
            raise InputError(f"metres_per_tick = {metres_per_tick:g} must be positive", value=metres_per_tick)
        if method not in METHODS:
            raise InputError(f'unknown method "{method}" of integration; use {", ".join(METHODS)}', method=method)
        self.drive = drive
        self.metres_per_tick = metres_per_tick
        self.method: Method = method
        self.pose = start
        """In the frame of the odometry (m, rad)."""
        self.velocity = Twist2D()
        """Mean velocity since the update before."""
        self._ticks: NDArray[np.int64] | None = None
        self._time = 0.0

    def update(self, ticks: Sequence[int] | NDArray[np.int64], time: float) -> Pose2D:
        """Return the pose for the total counts (n,) of the wheels at `time` (s). The first call sets the zero point.

        Raises InputError for a wrong number of counts, or a time before that of the last call.
        """
        counts = np.asarray(ticks, np.int64)
        if counts.shape != (len(self.drive.names),):
            raise InputError(f"{counts.size} counts for {len(self.drive.names)} wheels ({', '.join(self.drive.names)})")
        if self._ticks is not None:
            dt = time - self._time
            if dt < 0.0:
                raise InputError(f"the encoders' time {time:g} s is before the last one, {self._time:g} s", time=time)
            moved = self.drive.twist(self.metres_per_tick * (counts - self._ticks).astype(np.float64))
            self.pose = integrate(self.pose, moved, 1.0, self.method)
            if dt > 0.0:
                self.velocity = Twist2D(moved.vx / dt, moved.vy / dt, moved.wz / dt)
        self._ticks, self._time = counts.copy(), time
        return self.pose
