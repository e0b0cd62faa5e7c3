"""Speeds within acceleration limits: what may be commanded next."""

from __future__ import annotations

import math

from navstack.core import RobotState, Twist2D


def braking_speed(distance: float, acceleration: float, dt: float) -> float:
    """Return the largest speed (m/s or rad/s) from which the robot stops within `distance` (m or rad, not negative).

    The speed is held for one cycle of `dt` (s), then falls by `acceleration`: v dt + v² / 2a = distance. So it stops in time
    whether the base follows a command at once or at that acceleration.
    """
    change = acceleration * dt
    if not math.isfinite(change):
        return distance / dt
    return math.sqrt(change * change + 2.0 * acceleration * max(distance, 0.0)) - change


class Ramp:
    """The last command, from which the next one differs by at most one cycle's acceleration."""

    def __init__(self, acceleration: float, turn_acceleration: float) -> None:
        """Limits in m/s² and rad/s²; inf for none."""
        self.acceleration, self.turn_acceleration = acceleration, turn_acceleration
        self.last = Twist2D()

    def begin(self, state: RobotState) -> None:
        """Start from the robot's velocity."""
        self.last = Twist2D(state.velocity.vx, 0.0, state.velocity.wz)

    def towards(self, speed: float, turn_rate: float, dt: float) -> Twist2D:
        """Return the command nearest to `speed` (m/s) and `turn_rate` (rad/s) that one cycle of `dt` (s) allows."""
        vx = _within(speed, self.last.vx, self.acceleration * dt)
        wz = _within(turn_rate, self.last.wz, self.turn_acceleration * dt)
        self.last = Twist2D(vx, 0.0, wz)
        return self.last

    def braked(self, dt: float) -> Twist2D:
        """Return the command that brakes as hard as the limits allow, on the arc of the last one."""
        vx, wz = self.last.vx, self.last.wz
        shares = [
            abs(value) / (limit * dt)
            for value, limit in ((vx, self.acceleration), (wz, self.turn_acceleration))
            if value
        ]
        slowest = max(shares, default=0.0)
        factor = 1.0 - 1.0 / slowest if slowest > 1.0 else 0.0
        self.last = Twist2D(factor * vx, 0.0, factor * wz)
        return self.last

    def stopping_time(self) -> float:
        """Return the time (s) to a standstill from the last command."""
        return max(abs(self.last.vx) / self.acceleration, abs(self.last.wz) / self.turn_acceleration)


def _within(value: float, last: float, change: float) -> float:
    return min(max(value, last - change), last + change)
