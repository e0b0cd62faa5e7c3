"""A car: rear axle without differential slip, steered front wheels (Ackermann)."""

from __future__ import annotations

import math
from typing import NamedTuple

from navstack.core import Twist2D
from navstack.core.errors import InputError
from navstack.kinematics.drives import DifferentialDrive


class SteeringAngles(NamedTuple):
    """Steering angles (rad) of a car's front wheels, positive to the left."""

    centre: float
    """Angle of the wheel in the middle of the axle that the two wheels replace."""
    left: float
    right: float


class AckermannDrive:
    """A car whose base frame is at the centre of the rear axle: wz = v tan(steering) / wheelbase."""

    def __init__(self, wheelbase: float, track: float, max_steering_angle: float) -> None:
        """`wheelbase` and `track` in m; `max_steering_angle` (rad) of the (centre) front wheel, below pi / 2."""
        if not (wheelbase > 0.0 and track >= 0.0 and 0.0 < max_steering_angle < 0.5 * math.pi):
            raise InputError(
                f"a car needs wheelbase > 0, track >= 0 and 0 < max_steering_angle < pi / 2, not {wheelbase:g} m, {track:g} m "
                f"and {max_steering_angle:g} rad"
            )
        self.wheelbase, self.track, self.max_steering_angle = wheelbase, track, max_steering_angle

    @property
    def turning_radius(self) -> float:
        """Minimum radius (m) of the circle that the centre of the rear axle drives."""
        return self.wheelbase / math.tan(self.max_steering_angle)

    def steering(self, twist: Twist2D) -> float | None:
        """Return the steering angle (rad) for a velocity; None if the car cannot drive it.

        atan(wheelbase wz / v): it cannot turn in place, nor on a circle smaller than its turning radius.
        """
        if twist.vx == 0.0:
            return 0.0 if twist.wz == 0.0 else None
        angle = math.atan(self.wheelbase * twist.wz / twist.vx)
        return angle if abs(angle) <= self.max_steering_angle + 1e-12 else None

    def twist(self, speed: float, steering: float) -> Twist2D:
        """Return the velocity at `speed` (m/s) of the rear axle and a steering angle (rad)."""
        return Twist2D(speed, 0.0, speed * math.tan(steering) / self.wheelbase)

    def front_wheels(self, steering: float) -> SteeringAngles:
        """Return the angles of both front wheels, whose axes meet on the rear axle.

        cot(outer) - cot(inner) = track / wheelbase (Ackermann).
        """
        curvature = math.tan(steering) / self.wheelbase
        left, right = (
            math.atan(self.wheelbase * curvature / (1.0 - side * 0.5 * self.track * curvature)) for side in (1.0, -1.0)
        )
        return SteeringAngles(steering, left, right)

    def rear_wheel_speeds(self, twist: Twist2D) -> tuple[float, float]:
        """Return the velocities (m/s) of the left and right rear wheels' rims."""
        half = 0.5 * self.track
        return twist.vx - half * twist.wz, twist.vx + half * twist.wz

    def rear_axle(self) -> DifferentialDrive:
        """Return the rear axle as a differential drive, for odometry from its two wheels. Raises InputError for a track of 0."""
        return DifferentialDrive(self.track)
