"""At the goal's position: brake, then turn in place (base_local_planner's LatchedStopRotateController)."""

from __future__ import annotations

import math

from navstack.core import Twist2D
from navstack.interfaces import VelocityLimits


def braking_twist(velocity: Twist2D, limits: VelocityLimits, period: float) -> Twist2D:
    """`velocity` brought toward zero by one period's deceleration on every axis."""

    def slower(value: float, deceleration: float) -> float:
        return math.copysign(max(0.0, abs(value) - deceleration * period), value)

    return Twist2D(
        slower(velocity.vx, limits.acc_lim_x),
        slower(velocity.vy, limits.acc_lim_y),
        slower(velocity.wz, limits.acc_lim_theta),
    )


def turning_twist(error: float, turning: float, limits: VelocityLimits, period: float, slowest: float) -> Twist2D:
    """A turn in place toward an angle `error` (rad) away, while turning at `turning` (rad/s).

    The error itself as a speed, within one period's acceleration of the present one, no faster than can be stopped in time,
    and in the end always between `slowest` and the limit: a base that cannot turn slower would not move at all.
    """
    fastest = limits.max_vel_theta
    speed = min(fastest, max(slowest, abs(error)))
    change = limits.acc_lim_theta * period
    speed = min(max(speed, abs(turning) - change), abs(turning) + change)
    speed = min(math.sqrt(2.0 * limits.acc_lim_theta * abs(error)), speed)
    speed = min(fastest, max(slowest, speed))
    return Twist2D(0.0, 0.0, -speed if error < 0.0 else speed)
