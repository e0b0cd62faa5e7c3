"""When a simulated robot takes its next step: by the wall clock, or by the clock of another node."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Final

SLACK_S: Final = 1.0
"""A simulation that is later (s, wall) does not catch up: no burst of steps."""


class Pace(ABC):
    """Tells how long to wait for a simulated time."""

    start_ns: int
    """ROS's time of the simulated time 0 (ns)."""

    @abstractmethod
    def wait_s(self, reached_s: float) -> float:
        """Return how long to wait (s, wall) until the simulated time `reached_s` (s) is due; not positive: it is."""


class WallPace(Pace):
    """The wall clock, `speed` simulated seconds per second."""

    def __init__(self, speed: float, start_ns: int, *, stamps_wall_time: bool = False) -> None:
        """With `stamps_wall_time`, a delay also delays the stamps: otherwise all later data would be old."""
        self._speed, self._stamps_wall_time = speed, stamps_wall_time
        self._begin = time.monotonic()
        self.start_ns = start_ns

    def wait_s(self, reached_s: float) -> float:
        """Return the time to wait; a machine that is too slow delays what follows."""
        ahead = reached_s / self._speed - (time.monotonic() - self._begin)
        if ahead < -SLACK_S:
            self._begin -= ahead
            if self._stamps_wall_time:
                self.start_ns -= round(ahead * 1e9)
        return ahead


class ClockPace(Pace):
    """The clock of another node, such as that of a first simulated robot."""

    def __init__(self, now_ns: Callable[[], int]) -> None:
        """`now_ns` returns the time (ns) of that clock, which has begun."""
        self._now_ns = now_ns
        self.start_ns = self._last_ns = now_ns()

    def wait_s(self, reached_s: float) -> float:
        """Return 0 if the clock has come that far, else the time to the next look. A jump back of the clock is followed."""
        now_ns = self._now_ns()
        if now_ns < self._last_ns:
            self.start_ns -= self._last_ns - now_ns
        self._last_ns = now_ns
        return 0.0 if now_ns >= self.start_ns + reached_s * 1e9 else 0.002
