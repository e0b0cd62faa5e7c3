"""Seconds of a node: since its start, never backwards, whatever ROS's clock does."""

from __future__ import annotations

from typing import Any, Final

from navstack.logs.log import seconds

JUMP_NS: Final = 1_000_000
"""A clock that goes back by more (ns) has jumped."""


class NodeClock:
    """Converts ROS's times. When the clock jumps back (a bag restarts), the node's time goes on from where it was."""

    def __init__(self, rospy: Any) -> None:
        self._rospy = rospy
        self._start_ns = int(rospy.Time.now().to_nsec())
        self._last_ns = self._start_ns
        self.jumps = 0
        """Number of jumps backwards."""

    def now(self) -> float:
        """Return the present time (s)."""
        now_ns = int(self._rospy.Time.now().to_nsec())
        if now_ns < self._last_ns - JUMP_NS:
            self.jumps += 1
            self._start_ns += now_ns - self._last_ns
        self._last_ns = max(now_ns, self._last_ns) if self.jumps == 0 else now_ns
        return seconds(now_ns, self._start_ns)

    def of(self, stamp: Any) -> float:
        """Return the time (s) of a stamp of a message."""
        return seconds(int(stamp.to_nsec()), self._start_ns)

    def ns(self, time: float) -> int:
        """Return ROS's time (ns) of a time (s) of the node."""
        return self._start_ns + round(time * 1e9)
