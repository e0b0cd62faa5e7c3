"""Seconds of a node: since its start, never backwards, for any jump of ROS's clock; and a simulated clock that stands still."""

from __future__ import annotations

import bisect
import math
import time
from collections.abc import Callable
from typing import Any, Final

from navstack.ros_messages import seconds, time_ns
from navstack.ros_node.log import Log

JUMP_NS: Final = 1_000_000
"""A clock that goes back by more (ns) has jumped."""
STILL_S: Final = 1.0
"""A simulated clock that does not change for this time (s, wall) stands still."""


class NodeClock:
    """Converts ROS's times. When the clock jumps back (a bag restarts), the node's time goes on from where it was."""

    def __init__(self, now_ns: Callable[[], int]) -> None:
        """`now_ns` returns ROS's time (ns)."""
        self._now_ns = now_ns
        self._start_ns = now_ns()
        self._last_ns = self._start_ns
        self._parts: list[tuple[float, int]] = [(-math.inf, self._start_ns)]
        """Times (s) of the jumps, and ROS's time (ns) of the node's time 0 from then on."""

    @property
    def jumps(self) -> int:
        """Number of jumps backwards."""
        return len(self._parts) - 1

    def now(self) -> float:
        """Return the current time (s)."""
        now_ns = self._now_ns()
        if now_ns < self._last_ns - JUMP_NS:
            jumped_at = seconds(self._last_ns, self._start_ns)
            self._start_ns += now_ns - self._last_ns
            self._parts.append((jumped_at, self._start_ns))
        self._last_ns = max(now_ns, self._last_ns) if self.jumps == 0 else now_ns
        return seconds(now_ns, self._start_ns)

    def of(self, stamp: Any) -> float:
        """Return the time (s) of a stamp of a message."""
        return seconds(time_ns(stamp), self._start_ns)

    def ns(self, time: float) -> int:
        """Return ROS's time (ns) of a time (s) of the node; what was stamped before a jump keeps its stamp."""
        part = bisect.bisect_right(self._parts, time, key=lambda part: part[0]) - 1
        return max(0, self._parts[max(part, 0)][1] + round(time * 1e9))


class StillClock:
    """Notices that simulated time has stopped: a simulator that is paused, or that has ended."""

    def __init__(self, log: Log) -> None:
        self._log = log
        self._last = -1.0
        self._changed = time.monotonic()
        self.is_still = False
        """True while the clock stands still."""

    def is_new(self, now: float) -> bool:
        """Return True once when the clock has stood still at `now` (s) for `STILL_S`; both ends are logged."""
        wall = time.monotonic()
        if now != self._last:
            self._last, self._changed = now, wall
            if self.is_still:
                self.is_still = False
                self._log.logwarn("/clock goes on at %.3f s", now)
            return False
        if self.is_still or wall - self._changed < STILL_S:
            return False
        self.is_still = True
        self._log.logwarn(
            "/clock has stood still at %.3f s for %g s: the robot is stopped; goals wait until it goes on", now, STILL_S
        )
        return True
