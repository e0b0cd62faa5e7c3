"""The odometry at the times of the scans."""

from __future__ import annotations

import bisect
from collections import deque
from typing import Final

from navstack.core import Transform2D, angle_between

HISTORY: Final = 600
"""Odometry poses that are kept: a minute at 10 Hz."""


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
