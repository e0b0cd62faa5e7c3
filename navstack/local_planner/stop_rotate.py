"""Commands at the goal's position: brake, then turn in place (base_local_planner's LatchedStopRotateController)."""

from __future__ import annotations

import math

from navstack.core import Twist2D
from navstack.interfaces import VelocityLimits


def braking_twist(velocity: Twist2D, limits: VelocityLimits, period: float) -> Twist2D:
    """`velocity` reduced towards zero by one period's deceleration on every axis."""

    def slower(value: float, deceleration: float) -> float:
        return math.copysign(max(0.0, abs(value) - deceleration * period), value)

    return Twist2D(
        slower(velocity.vx, limits.acc_lim_x),
        slower(velocity.vy, limits.acc_lim_y),
        slower(velocity.wz, limits.acc_lim_theta),
    )


def turning_twist(error: float, turning: float, limits: VelocityLimits, period: float, slowest: float) -> Twist2D:
    """A turn in place that reduces the heading error `error` (rad), at the current turning speed `turning` (rad/s).

    The speed equals the error, within one period's acceleration of the current speed and low enough to stop in time. It is
    finally clamped between `slowest`, below which the base would not turn, and the limit.
    """
    fastest = limits.max_vel_theta
    speed = min(fastest, max(slowest, abs(error)))
    change = limits.acc_lim_theta * period
    speed = min(max(speed, abs(turning) - change), abs(turning) + change)
    speed = min(math.sqrt(2.0 * limits.acc_lim_theta * abs(error)), speed)
    speed = min(fastest, max(slowest, speed))
    return Twist2D(0.0, 0.0, -speed if error < 0.0 else speed)
