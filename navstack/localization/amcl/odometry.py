"""The odometry at the times of the scans, and what the corrections say about its systematic errors."""

from __future__ import annotations

import bisect
import math
from collections import deque
from typing import Final

from navstack.core import Pose2D, Transform2D, angle_between

HISTORY: Final = 600
"""Odometry poses that are kept: a minute at 10 Hz."""
WINDOW_M: Final = 20.0
"""Distance over which the odometry's errors are averaged."""
PRIOR_M: Final = 2.0
"""Distance that counts for an odometry without errors."""
LARGEST_SCALE: Final = 0.2
LARGEST_TURN: Final = 0.3


class OdometryHistory:
    """Poses of the base in the odometry frame over time."""

    def __init__(self) -> None:
        self._stamps: deque[float] = deque(maxlen=HISTORY)
        self._poses: deque[Transform2D] = deque(maxlen=HISTORY)

    def add(self, stamp: float, pose: Transform2D) -> None:
        """Append the pose at `stamp` (s), which is not older than the last."""
        self._stamps.append(stamp)
        self._poses.append(pose)

    def since(self, stamp: float) -> Transform2D:
        """Return the motion of the base from `stamp` (s) to the last pose; none for a stamp outside of the history."""
        if not self._stamps or stamp >= self._stamps[-1] or stamp < self._stamps[0]:
            return Transform2D()
        stamps = list(self._stamps)
        after = bisect.bisect_right(stamps, stamp)
        a, b = self._poses[after - 1], self._poses[after]
        span = stamps[after] - stamps[after - 1]
        share = (stamp - stamps[after - 1]) / span if span > 0.0 else 0.0
        then = Transform2D(
            a.x + share * (b.x - a.x), a.y + share * (b.y - a.y), a.yaw + share * angle_between(a.yaw, b.yaw)
        )
        return then.inverse() @ self._poses[-1]


class OdometryErrors:
    """Turn per metre and scale of the odometry, averaged over the last metres of driving.

    The corrections of the filter are compared with the odometry from estimate to estimate. Their errors cancel in the sum, so
    the averages come close to the drift over the whole window.
    """

    def __init__(self) -> None:
        self._last: tuple[Pose2D, Transform2D] | None = None
        self._distance = 0.0
        self._turned = 0.0
        self._longer = 0.0

    @property
    def turn(self) -> float:
        """True turn to the left beyond that of the odometry (rad/m)."""
        return _clip(self._turned / (self._distance + PRIOR_M), LARGEST_TURN)

    @property
    def scale(self) -> float:
        """True distance beyond that of the odometry, relative."""
        return _clip(self._longer / (self._distance + PRIOR_M), LARGEST_SCALE)

    def forget(self) -> None:
        """Compare nothing with the pose before a jump."""
        self._last = None

    def learn(self, pose: Pose2D, odometry: Transform2D) -> None:
        """Take the estimated pose at an odometry pose."""
        last, self._last = self._last, (pose, odometry)
        if last is None:
            return
        motion = last[1].inverse() @ odometry
        distance = math.hypot(motion.x, motion.y)
        turned = angle_between(motion.yaw, angle_between(last[0].yaw, pose.yaw))
        if distance < 1e-6 or abs(turned) > 1.0:
            return
        kept = math.exp(-distance / WINDOW_M)
        self._distance = kept * self._distance + distance
        self._turned = kept * self._turned + turned
        self._longer = kept * self._longer + last[0].distance_to(pose) - distance

    def corrected(self, motion: tuple[float, float, float]) -> tuple[float, float, float]:
        """Return `motion` (dx, dy in the odometry frame, dyaw) without the systematic errors."""
        dx, dy, dyaw = motion
        distance = math.hypot(dx, dy)
        turn, scale = self.turn * distance, 1.0 + self.scale
        c, s = math.cos(0.5 * turn), math.sin(0.5 * turn)
        return scale * (c * dx - s * dy), scale * (s * dx + c * dy), dyaw + turn


def _clip(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))
