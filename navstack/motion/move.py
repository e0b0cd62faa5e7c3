"""move: drive a distance straight ahead or backwards.

Source of the names and of the idea: the node LinearMove of the ROS tutorials. ROS differs: that node measures the straight-line
distance from the start and stops within a window around it, so that a push or a long cycle makes it drive on for ever; it has no
acceleration limits and no collision checks. Here the distance is measured along the start's heading, and the robot is kept on
the line.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.core import Pose2D, RobotState, Transform2D
from navstack.interfaces import RecoveryStep
from navstack.motion.base import BasicMotion
from navstack.motion.errors import InvalidMotionError
from navstack.motion.obstacles import straight
from navstack.motion.ramp import braking_speed
from navstack.motion.tracking import TrackingError, track
from navstack.parameters.models.motion import MotionParams


class Move(BasicMotion):
    """Drives `distance` (m), backwards if negative, and stops within `tolerance`."""

    def __init__(self, distance: float, params: MotionParams | None = None, name: str = "move") -> None:
        """Raise InvalidMotionError for a distance that is not finite."""
        super().__init__(name, params or MotionParams())
        if not math.isfinite(distance):
            raise InvalidMotionError(f"the distance {distance} of {name} is not finite", distance=distance)
        self.distance = distance
        self._line = Transform2D()
        self._driven = 0.0

    def describe(self) -> dict[str, Any]:
        """Return the distance (m)."""
        return {"move": self.distance}

    def begin(self, pose: Pose2D, state: RobotState) -> float:
        """Start the line at `pose`."""
        del state
        self._line = Transform2D(*pose)
        self.target = self._line.apply(Pose2D(self.distance, 0.0))
        self.reference = self.line(pose, self.target)
        limits = self.limits
        speed = min(self.params.speed_linear, limits.max_speed)
        return abs(self.distance) / speed + 2.0 * speed / limits.max_acceleration

    def command(self, pose: Pose2D, state: RobotState, now: float, dt: float) -> RecoveryStep:
        """Return the next step."""
        on_line = self._line.inverse().apply(pose)
        self._driven = on_line.x
        left = self.distance - on_line.x
        data = {"driven_m": on_line.x, "left_m": abs(left), "across_m": on_line.y}
        limits, p = self.limits, self.params
        slow = abs(self._ramp.last.vx) <= limits.max_acceleration * dt
        if abs(left) <= p.tolerance and slow:
            if self.is_standing(state):
                return self.done(data)
            return self.running(self._ramp.towards(0.0, 0.0, dt), data, f"stopping, {left:.3f} m from the target")
        cruise = min(p.speed_linear, limits.max_speed)
        speed = math.copysign(min(cruise, braking_speed(abs(left), limits.max_acceleration, dt)), left)
        # the reference is the point of the line beside the robot
        error = TrackingError(0.0, -on_line.y * math.cos(on_line.yaw), -on_line.yaw)
        _, turn_rate = track(error, speed, 0.0, p)
        turn_rate = min(max(turn_rate, -limits.max_turn_rate), limits.max_turn_rate)
        what = "cruising" if abs(speed) == cruise else "braking for the target"
        return self.running(
            self._ramp.towards(speed, turn_rate, dt),
            data,
            f"{what}: {on_line.x:.3f} of {self.distance:.3f} m driven, {abs(on_line.y):.3f} m off the line",
        )

    def ahead(self, pose: Pose2D, now: float, *, whole: bool) -> NDArray[np.float64]:
        """Return the rest of the line, or what `simulate_ahead_time` covers."""
        del now
        left = self.distance - self._line.inverse().apply(pose).x
        reach = abs(left) if whole else min(abs(left), self.params.speed_linear * self.params.simulate_ahead_time)
        return straight(self.context, math.copysign(reach, left))

    def summary(self) -> str:
        """Return the distance driven."""
        return f"{self.name} drove {self._driven:.3f} of {self.distance:.3f} m"
