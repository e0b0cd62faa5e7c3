"""Rejects odometry that is old or impossible: velocities far beyond the limits of the local planner, and poses that jump.

ROS differs: C++ uses every odometry message as it is.
"""

from __future__ import annotations

import math
from typing import Final

from navstack.core import Pose2D, RobotState, angle_between
from navstack.interfaces import LocalPlanner
from navstack.move_base import plugin_calls
from navstack.move_base.errors import OdometryError, StaleOdometryError

FACTOR: Final = 3.0
"""A robot may be this many times faster than the local planner's limits: pushed, downhill, or driven by another node."""
LINEAR_MARGIN: Final = 1.0
"""m/s above `FACTOR` times the limit."""
ANGULAR_MARGIN: Final = 3.0
"""rad/s above `FACTOR` times the limit."""
FASTEST: Final = 100.0
"""Largest possible velocity (m/s and rad/s) of a planner without limits."""
JUMP_M: Final = 0.5
"""A pose may move by this (m) beyond the distance at the largest velocity."""
JUMP_RAD: Final = 0.5
"""A heading may turn by this (rad) beyond the angle at the largest angular velocity."""
GAP_S: Final = 1.0
"""Poses farther apart in time are not compared: between two goals a robot may be carried, or its odometry restarted."""
SETTLE_S: Final = 1.0
"""The odometry counts as impossible until this time (s) after its last jump, but at most half of controller_patience."""


class OdometryCheck:
    """Compares each odometry with the limits of the local planner and with the previous pose."""

    def __init__(self) -> None:
        self._planner: LocalPlanner | None = None
        self._linear = self._angular = 0.0
        """Largest possible velocities (m/s, rad/s)."""
        self._last: Pose2D | None = None
        self._last_at = -math.inf
        self._frame = ""
        self._jump: OdometryError | None = None
        self._jump_at = -math.inf

    def reset(self) -> None:
        """Reset the previous pose and its jumps: a new goal begins."""
        self._last = self._jump = None

    def check(self, state: RobotState, planner: LocalPlanner, now: float, settle_s: float = math.inf) -> None:
        """Check the odometry of `now` (s): pose in the odometry frame, velocity.

        Raises OdometryError, after a jump for `SETTLE_S`, at most `settle_s` (s).
        """
        velocity = state.velocity
        if planner is not self._planner:
            self._planner, self._linear, self._angular = planner, LINEAR_MARGIN, ANGULAR_MARGIN
        vx, vy, wz = velocity
        speed, turn = math.hypot(vx, vy), abs(wz)
        if speed > self._linear or turn > self._angular:
            self._read_limits(planner)
        self._compare(state, now)
        if not (speed <= self._linear and turn <= self._angular):
            raise OdometryError(
                f"the odometry reports {speed:.3g} m/s and {turn:.3g} rad/s, far beyond the limits of the local planner "
                f"(possible: {self._linear:.3g} m/s, {self._angular:.3g} rad/s); check the units and the source of the odometry",
                velocity=list(velocity),
                possible=[self._linear, self._angular],
            )
        if self._jump is not None:
            if now == self._jump_at or now - self._jump_at < min(SETTLE_S, settle_s):
                raise self._jump
            self._jump = None

    def _read_limits(self, planner: LocalPlanner) -> None:
        """Raise the largest possible velocities to those of the planner; limits lowered for a while do not lower them."""
        limits = plugin_calls.limits_of(planner)
        x = max(abs(limits.max_vel_x), abs(limits.min_vel_x))
        y = max(abs(limits.max_vel_y), abs(limits.min_vel_y))
        linear = max(math.hypot(x, y), abs(limits.max_vel_trans))
        angular = max(abs(limits.max_vel_theta), abs(limits.min_vel_theta))
        self._linear = max(self._linear, _possible(linear, LINEAR_MARGIN))
        self._angular = max(self._angular, _possible(angular, ANGULAR_MARGIN))

    def _compare(self, state: RobotState, now: float) -> None:
        """Compare the pose with the previous one."""
        pose, last, elapsed = state.pose, self._last, now - self._last_at
        self._last, self._last_at = pose, now
        frame, self._frame = self._frame, state.frame
        if last is None or elapsed > GAP_S or frame != state.frame:
            return
        x, y, yaw = last
        if abs(pose[0] - x) + abs(pose[1] - y) <= JUMP_M and abs(pose[2] - yaw) <= JUMP_RAD:
            return
        moved, turned = last.distance_to(pose), abs(angle_between(yaw, pose.yaw))
        if moved <= JUMP_M and turned <= JUMP_RAD:
            return
        if self._planner is not None:
            self._read_limits(self._planner)
        if not (moved <= JUMP_M + self._linear * elapsed and turned <= JUMP_RAD + self._angular * elapsed):
            self._jump_at = now
            self._jump = OdometryError(
                f'the pose of the odometry in "{state.frame}" jumped by {moved:.3g} m and {turned:.3g} rad in {elapsed:.3f} s, '
                f"from ({last.x:.3g}, {last.y:.3g}) to ({pose.x:.3g}, {pose.y:.3g}); check the source of the odometry",
                before=list(last),
                after=list(pose),
                elapsed_s=elapsed,
            )


def check_age(state: RobotState, now: float, tolerance_s: float) -> None:
    """Check that the odometry is at most `tolerance_s` (s) old at `now` (s); one without a stamp (0) counts as new.

    Raises StaleOdometryError.
    """
    age = now - state.stamp
    if age <= tolerance_s or state.stamp == 0.0:
        return
    raise StaleOdometryError(
        f'the odometry in "{state.frame}" is {age:.3g} s old (stamp {state.stamp:.3f} s), more than transform_tolerance = '
        f"{tolerance_s:g} s; check that its source still publishes, and that its clock is this one",
        age_s=age,
        stamp=state.stamp,
        transform_tolerance=tolerance_s,
    )


def _possible(limit: float, margin: float) -> float:
    # `min` also replaces infinity; a limit that is NaN becomes FASTEST
    return min(FASTEST, FACTOR * limit + margin) if limit == limit else FASTEST
