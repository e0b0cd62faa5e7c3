"""Detects a robot that is commanded to move and does not: it pushes against something, or its wheels are blocked.

ROS differs: move_base has no such check; the robot pushes until oscillation_timeout, which is off by default.
"""

from __future__ import annotations

import math
from typing import Final

from navstack.core import Pose2D, RobotState, Twist2D, angle_between
from navstack.interfaces import VelocityLimits
from navstack.move_base.errors import NoProgressError

SLOWEST_M: Final = 0.05
"""Slower commands (m/s) are not expected to move a robot: friction, dead bands of the wheels."""
SLOWEST_RAD: Final = 0.2
"""Slower turns (rad/s) are not expected to move a robot."""
MOVED_M: Final = 0.02
"""A robot that has moved by this (m) is not stalled."""
MOVED_RAD: Final = 0.05
"""A robot that has turned by this (rad) is not stalled."""

MEASURED: Final = 0.3
"""A robot whose odometry measures this share of the commanded velocity is not stalled."""


class StallCheck:
    """Compares what was commanded for a goal with how the robot moves.

    A stalled robot counts as stalled until `reset`, as it stands then and nothing new can be measured.
    """

    def __init__(self) -> None:
        self.unproven = False
        """True from a stall until the robot has moved."""
        self._anchor: Pose2D | None = None
        self._since = 0.0
        self._error: NoProgressError | None = None

    def reset(self) -> None:
        """Allow commands again: a recovery behavior has ended. The robot has yet to prove that it moves."""
        self._anchor = self._error = None

    def check(self, state: RobotState, sent: Twist2D, limits: VelocityLimits, timeout_s: float, now: float) -> None:
        """Check the motion up to `now` (s). `state`: the odometry, `sent`: the command that the robot is executing.

        `timeout_s`: longest time (s) without motion, beyond the time to reach the commanded velocity. Raises NoProgressError from
        the time at which the robot counts as stalled until `reset`.
        """
        if self._error is not None:
            raise self._error
        anchor = self._anchor
        if anchor is not None and _has_moved(anchor, state, sent):
            self.unproven = False
            anchor = None
        speed, turn = math.hypot(sent.vx, sent.vy), abs(sent.wz)
        slowest = max(SLOWEST_M, 0.9 * min(limits.min_vel_trans, limits.max_vel_trans))
        slowest_turn = max(SLOWEST_RAD, 0.9 * min(limits.min_vel_theta, limits.max_vel_theta))
        if speed < slowest and turn < slowest_turn:
            self._anchor = None
            return
        if anchor is None:
            self._anchor, self._since = state.pose, now
            return
        allowed = timeout_s + max(
            _time_to(speed, limits.acc_lim_x, limits.acc_lim_y), _time_to(turn, limits.acc_lim_theta)
        )
        if now - self._since < allowed:
            return
        self.unproven = True
        self._error = NoProgressError(
            f"the robot does not move: for {now - self._since:.1f} s it was commanded ({sent.vx:.2f}, {sent.vy:.2f}) m/s, "
            f"{sent.wz:.2f} rad/s, and its odometry stayed within {MOVED_M:g} m and {MOVED_RAD:g} rad of "
            f"({anchor.x:.2f}, {anchor.y:.2f}); it may push against something that its sensors do not see, its "
            "wheels may be blocked, or an emergency stop may be active (navstack/stall_timeout)",
            command=list(sent),
            velocity=list(state.velocity),
            seconds=now - self._since,
            stall_timeout=timeout_s,
        )
        raise self._error


def _has_moved(anchor: Pose2D, state: RobotState, sent: Twist2D) -> bool:
    """True if the pose has changed, or the odometry measures a part of the commanded velocity."""
    pose, (vx, vy, wz) = state.pose, state.velocity
    if anchor.distance_to(pose) >= MOVED_M or abs(angle_between(anchor.yaw, pose.yaw)) >= MOVED_RAD:
        return True
    speed, turn = math.hypot(sent.vx, sent.vy), abs(sent.wz)
    return (speed >= SLOWEST_M and math.hypot(vx, vy) >= MEASURED * speed) or (
        turn >= SLOWEST_RAD and abs(wz) >= MEASURED * turn
    )


def _time_to(speed: float, *accelerations: float) -> float:
    """Time (s) to reach a speed; 0 without a limit, at most 1 s."""
    limits = [a for a in accelerations if a > 0.0 and math.isfinite(a)]
    return min(speed / min(limits), 1.0) if limits else 0.0
