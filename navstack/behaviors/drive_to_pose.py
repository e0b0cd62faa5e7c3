"""drive_to_pose: turn towards a pose, drive straight to it, turn to its heading. No planner: the way must be free."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.behaviors.base import Motion, braking_speed, straight, turning
from navstack.behaviors.errors import InvalidMotionError
from navstack.behaviors.follow import steering_to_line
from navstack.core import Pose2D, RobotState, Transform2D, angle_between, normalize_angle
from navstack.parameters import MotionParams
from navstack.plugins import BehaviorStep


class DriveToPose(Motion):
    """Drives to a pose in three phases: face it, drive along the straight line, face its heading.

    The robot may start and end next to the line by the tolerances; on the line it is steered as by `Move`.
    """

    def __init__(
        self,
        pose: Pose2D,
        params: MotionParams | None = None,
        name: str = "drive_to_pose",
        *,
        measured_in: str = "map",
        backwards: bool = False,
    ) -> None:
        """`pose` (m, rad) in the frame `measured_in`, "map" or "odom". Raises InvalidMotionError if it is not finite."""
        super().__init__(name, params)
        if not pose.is_finite():
            raise InvalidMotionError(f"the pose {tuple(pose)} of {name} is not finite", pose=pose)
        self.measured_in = measured_in
        self.goal, self.backwards = pose, backwards
        self._phase = ""
        self._line = Transform2D()
        self._length = self._left = 0.0

    def describe(self) -> dict[str, Any]:
        """Return the pose."""
        return {"drive_to": list(self.goal), "backwards": self.backwards}

    def prepare(self, pose: Pose2D, state: RobotState) -> float:
        """Lay the line from `pose` to the goal. Raises InvalidMotionError for a base with a turning radius."""
        del state
        self.require_turning(self.name)
        self.target = self.goal
        self.reference = self.line(pose, self.goal)
        self._length = self._left = pose.distance_to(self.goal)
        # a goal next to the robot needs no line: its direction would be noise
        self._phase = "face the line" if self._length > self.params.tolerance else "face the goal"
        away = math.pi if self.backwards else 0.0
        bearing = normalize_angle(math.atan2(self.goal.y - pose.y, self.goal.x - pose.x) + away)
        self._line = Transform2D(pose.x, pose.y, bearing)
        limits, p = self.limits, self.params
        speed, rate = min(p.speed_linear, limits.max_speed), min(p.speed_radian, limits.max_turn_rate)
        times = speed / limits.max_acceleration + 2.0 * rate / limits.max_turn_acceleration
        return self._length / speed + 2.0 * math.pi / rate + 2.0 * times

    def command(self, pose: Pose2D, state: RobotState, now: float) -> BehaviorStep:
        """Return the next step; a phase that is complete is followed by the next one at once."""
        del now
        limits, p = self.limits, self.params
        self._left = pose.distance_to(self.goal)
        data = {"left_m": self._left, "left_rad": abs(angle_between(pose.yaw, self.goal.yaw))}
        slow = abs(self._ramp.last.wz) <= limits.max_turn_acceleration * self.dt and self.is_standing(state)
        if self._phase == "face the line":
            error = angle_between(pose.yaw, self._line.yaw)
            if abs(error) > p.tolerance_radian or not slow:
                return self._turn(error, data)
            self._phase = "drive"
        if self._phase == "drive":
            step = self._drive(pose, state, data)
            if step is not None:
                return step
            self._phase = "face the goal"
        error = angle_between(pose.yaw, self.goal.yaw)
        if abs(error) > p.tolerance_radian or not slow:
            return self._turn(error, data)
        self._phase = "reached"
        return self.done(data)

    def ahead(self, pose: Pose2D, now: float, *, whole: bool) -> NDArray[np.float64]:
        """Return the rest of the phase within `simulate_ahead_time`, or the rest of all phases."""
        del now
        p = self.params
        first = angle_between(pose.yaw, self._line.yaw)
        last = angle_between(self._line.yaw, self.goal.yaw)
        distance = math.copysign(self._left, -1.0 if self.backwards else 1.0)
        if whole:
            parts = [turning(angle_between(pose.yaw, self.goal.yaw))]
            if self._phase != "face the goal":
                facing = Transform2D(0.0, 0.0, first)
                there = facing @ Transform2D(distance, 0.0, 0.0)
                parts = [turning(first), facing.apply_poses(straight(self.context.local_costmap, distance))]
                parts.append(there.apply_poses(turning(last)))
            return np.concatenate(parts)
        if self._phase == "drive":
            reach = min(abs(distance), p.speed_linear * p.simulate_ahead_time)
            return straight(self.context.local_costmap, math.copysign(reach, distance))
        angle = first if self._phase == "face the line" else angle_between(pose.yaw, self.goal.yaw)
        reach = min(abs(angle), p.speed_radian * p.simulate_ahead_time)
        return turning(math.copysign(reach, angle))

    def summary(self) -> str:
        """Return the phase and the distance that is left."""
        at = f"({self.goal.x:.2f}, {self.goal.y:.2f}, {self.goal.yaw:.2f})"
        return f"{self.name} to {at}: {self._phase}, {self._left:.3f} of {self._length:.3f} m left"

    def _turn(self, error: float, data: dict[str, Any]) -> BehaviorStep:
        limits, p = self.limits, self.params
        fastest = min(p.speed_radian, limits.max_turn_rate, 0.5 * math.pi * p.frequency)
        rate = min(fastest, braking_speed(abs(error), limits.max_turn_acceleration, self.dt))
        if abs(error) <= p.tolerance_radian:
            rate = 0.0
        note = f"{self._phase}: {math.degrees(error):.1f} degrees left"
        return self.running(0.0, math.copysign(rate, error), data, note)

    def _drive(self, pose: Pose2D, state: RobotState, data: dict[str, Any]) -> BehaviorStep | None:
        """Return the next step on the line; None at its end."""
        limits, p = self.limits, self.params
        on_line = self._line.inverse().apply(pose)
        left = (-1.0 if self.backwards else 1.0) * self._length - on_line.x
        if abs(left) <= p.tolerance and abs(self._ramp.last.vx) <= limits.max_acceleration * self.dt:
            if self.is_standing(state):
                return None
            return self.running(0.0, 0.0, data, "stopping at the goal")
        cruise = min(p.speed_linear, limits.max_speed)
        speed = math.copysign(min(cruise, braking_speed(abs(left), limits.max_acceleration, self.dt)), left)
        rate = steering_to_line(on_line, speed, limits.max_turn_rate, p)
        note = f"drive: {abs(left):.3f} m left, {abs(on_line.y):.3f} m off the line"
        return self.running(speed, rate, data, note)
