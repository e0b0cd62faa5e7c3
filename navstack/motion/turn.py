"""turn: turn in place by any angle.

Source of the names and of the idea: the node RadianTurn of the ROS tutorials. ROS differs: that node turns to the angle modulo a
full turn, the shorter way, and misses targets near 0 because it does not wrap the difference; its variant for larger angles adds
up the tolerance of each part. Here the angle is counted beyond full turns.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.core import Pose2D, RobotState, angle_between, normalize_angle
from navstack.interfaces import RecoveryStep
from navstack.motion.base import BasicMotion
from navstack.motion.errors import InvalidMotionError
from navstack.motion.obstacles import turning
from navstack.motion.ramp import braking_speed
from navstack.parameters.models.motion import MotionParams


class Turn(BasicMotion):
    """Turns by `angle` (rad), clockwise if negative, more than a full turn too, and stops within `tolerance_radian`."""

    def __init__(
        self, angle: float, params: MotionParams | None = None, name: str = "turn", *, shortest: bool = False
    ) -> None:
        """`shortest`: turn to the same heading by at most half a turn. Raises InvalidMotionError if `angle` is not finite."""
        super().__init__(name, params or MotionParams())
        if not math.isfinite(angle):
            raise InvalidMotionError(f"the angle {angle} of {name} is not finite", angle=angle)
        self.angle = normalize_angle(angle) if shortest else angle
        self._turned = 0.0
        self._yaw = 0.0

    def describe(self) -> dict[str, Any]:
        """Return the angle (rad)."""
        return {"turn": self.angle}

    def begin(self, pose: Pose2D, state: RobotState) -> float:
        """Start from the heading of `pose`. Raises InvalidMotionError for a base with a turning radius."""
        del state
        self.require_turning(self.name)
        self._turned, self._yaw = 0.0, pose.yaw
        self.target = Pose2D(pose.x, pose.y, normalize_angle(pose.yaw + self.angle))
        self.reference = self.line(pose, self.target)
        limits = self.limits
        speed = self._fastest()
        return abs(self.angle) / speed + 2.0 * speed / limits.max_turn_acceleration

    def command(self, pose: Pose2D, state: RobotState, now: float, dt: float) -> RecoveryStep:
        """Return the next step."""
        del now
        self._turned += angle_between(self._yaw, pose.yaw)
        self._yaw = pose.yaw
        left = self.angle - self._turned
        data = {"turned_rad": self._turned, "left_rad": abs(left)}
        limits, p = self.limits, self.params
        slow = abs(self._ramp.last.wz) <= limits.max_turn_acceleration * dt
        if abs(left) <= p.tolerance_radian and slow:
            if self.is_standing(state):
                return self.done(data)
            note = f"stopping, {math.degrees(left):.1f} degrees from the target"
            return self.running(self._ramp.towards(0.0, 0.0, dt), data, note)
        fastest = self._fastest()
        rate = math.copysign(min(fastest, braking_speed(abs(left), limits.max_turn_acceleration, dt)), left)
        what = "turning" if abs(rate) == fastest else "braking for the target"
        turned, angle = math.degrees(self._turned), math.degrees(self.angle)
        return self.running(
            self._ramp.towards(0.0, rate, dt), data, f"{what}: {turned:.1f} of {angle:.1f} degrees turned"
        )

    def ahead(self, pose: Pose2D, now: float, *, whole: bool) -> NDArray[np.float64]:
        """Return the rest of the turn, or what `simulate_ahead_time` covers."""
        del pose, now
        left = self.angle - self._turned
        reach = abs(left) if whole else min(abs(left), self._fastest() * self.params.simulate_ahead_time)
        return turning(math.copysign(reach, left))

    def summary(self) -> str:
        """Return the angle turned."""
        return f"{self.name} turned {math.degrees(self._turned):.1f} of {math.degrees(self.angle):.1f} degrees"

    def _fastest(self) -> float:
        # a robot cannot be followed through more than half a turn per cycle
        return min(self.params.speed_radian, self.limits.max_turn_rate, 0.5 * math.pi * self.params.frequency)
