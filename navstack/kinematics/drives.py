"""Bases whose wheel velocities are linear in the velocity of the base: differential, omnidirectional and mecanum.

Wheel velocities are those of the rims, in m/s, positive when they push the base forward; divided by the wheel's radius they are
rad/s. Sources: Siegwart, Nourbakhsh, Introduction to Autonomous Mobile Robots, chapter 3; Lynch, Park, Modern Robotics,
section 13.2 (omni and mecanum wheels).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from navstack.core import Twist2D
from navstack.core.errors import InputError


class WheelDrive:
    """A base with n wheels: the wheel velocities are `matrix` times (vx, vy, wz).

    `limits` and the simulator need nothing else, so any base of this kind can be described by its matrix.
    """

    def __init__(self, matrix: NDArray[np.float64], names: Sequence[str], *, sideways: bool) -> None:
        """`matrix` (n, 3): velocity of each wheel's rim (m/s) per vx, vy (m/s) and wz (rad/s); `names` of the wheels.

        `sideways`: whether the base can move sideways. Raises InputError for a matrix that does not determine the motion.
        """
        self.matrix = np.array(matrix, np.float64)
        self.names = tuple(names)
        self.sideways = sideways
        moved = [0, 1, 2] if sideways else [0, 2]
        if self.matrix.shape != (len(self.names), 3) or not np.isfinite(self.matrix).all():
            raise InputError(f"the matrix of a base with {len(self.names)} wheels must be finite and (n, 3)")
        if np.linalg.matrix_rank(self.matrix[:, moved]) < len(moved):
            raise InputError("the wheels do not determine the motion of the base; check their positions and directions")
        self.inverse = np.zeros((3, len(self.names)))
        """(3, n): vx, vy, wz from the wheel velocities; least squares if there are more wheels than motions."""
        self.inverse[moved] = np.linalg.pinv(self.matrix[:, moved])

    def wheel_speeds(self, twist: Twist2D) -> NDArray[np.float64]:
        """Return the velocities (n,) of the wheels' rims (m/s) for a velocity of the base."""
        return self.matrix @ np.array(twist)

    def twist(self, speeds: Sequence[float] | NDArray[np.float64]) -> Twist2D:
        """Return the velocity of the base for velocities (n,) of the wheels' rims (m/s)."""
        vx, vy, wz = (float(v) for v in self.inverse @ np.asarray(speeds, np.float64))
        return Twist2D(vx, vy, wz)

    def limited(self, twist: Twist2D, max_wheel_speed: float) -> Twist2D:
        """Return the velocity with the direction of `twist` at which no wheel exceeds `max_wheel_speed` (m/s).

        One factor for all components: the base stays on its arc, only slower.
        """
        fastest = float(np.abs(self.wheel_speeds(twist)).max())
        if fastest <= max_wheel_speed:
            return twist
        factor = max_wheel_speed / fastest
        return Twist2D(factor * twist.vx, factor * twist.vy, factor * twist.wz)


class DifferentialDrive(WheelDrive):
    """Two driven wheels on one axle: vL = v - wz d / 2, vR = v + wz d / 2; v = (vR + vL) / 2, wz = (vR - vL) / d."""

    def __init__(self, wheel_separation: float) -> None:
        """`wheel_separation` d (m): distance between the contact points of the two wheels."""
        _require_positive("wheel_separation", wheel_separation)
        self.wheel_separation = wheel_separation
        half = 0.5 * wheel_separation
        super().__init__(np.array([[1.0, 0.0, -half], [1.0, 0.0, half]]), ("left", "right"), sideways=False)


class OmniDrive(WheelDrive):
    """Omni wheels on a circle around the centre, each rolling along the tangent, counter-clockwise if positive."""

    def __init__(self, radius: float, angles: Sequence[float] = (math.pi / 3.0, math.pi, -math.pi / 3.0)) -> None:
        """`radius` (m) of the circle; `angles` (rad) of the wheels on it from straight ahead, by default three at 120 degrees."""
        _require_positive("radius", radius)
        at = np.asarray(angles, np.float64)
        matrix = np.stack((-np.sin(at), np.cos(at), np.full(len(at), radius)), axis=1)
        super().__init__(matrix, tuple(f"wheel_{i}" for i in range(len(at))), sideways=True)


class MecanumDrive(WheelDrive):
    """Four mecanum wheels with rollers at 45 degrees that form an X seen from above."""

    def __init__(self, wheelbase: float, track: float) -> None:
        """`wheelbase` (m) between the axles, `track` (m) between the wheels of an axle."""
        _require_positive("wheelbase", wheelbase)
        _require_positive("track", track)
        arm = 0.5 * (wheelbase + track)
        matrix = np.array([[1.0, -1.0, -arm], [1.0, 1.0, arm], [1.0, 1.0, -arm], [1.0, -1.0, arm]])
        super().__init__(matrix, ("front_left", "front_right", "rear_left", "rear_right"), sideways=True)


def _require_positive(name: str, value: float) -> None:
    if not (math.isfinite(value) and value > 0.0):
        raise InputError(f"{name} = {value:g} must be a positive length in metres", parameter=name, value=value)
