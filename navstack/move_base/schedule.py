"""When something that happens so many times a second is due next.

Times are computed from an anchor and a count, so that a schedule never drifts. The rule for being late is that of
ros::Rate (roscpp rate.cpp): who is late by less than a period catches up, who is late by more starts afresh.
"""

from __future__ import annotations

import math

EPSILON_S = 1e-6
"""Two times closer than this are the same: callers add up steps of simulated time in floating point."""


class Schedule:
    """Due at `anchor + k / frequency`; a frequency of zero is never due."""

    __slots__ = ("_anchor", "_count", "due", "frequency")

    def __init__(self, frequency: float, now: float = 0.0) -> None:
        """First due at `now` (s), then `frequency` (Hz) times a second."""
        self.frequency = frequency
        self._anchor = now
        self._count = 0
        self.due = now if frequency > 0.0 else math.inf
        """The next time (s); inf for never."""

    @property
    def period(self) -> float:
        """Seconds between two times; inf for never."""
        return 1.0 / self.frequency if self.frequency > 0.0 else math.inf

    def is_due(self, now: float) -> bool:
        """True at and after the next time."""
        return now >= self.due - EPSILON_S

    def restart(self, now: float) -> None:
        """Due at `now`, and from there on."""
        if self.frequency > 0.0:
            self._anchor = self.due = now
            self._count = 0

    def advance(self, now: float) -> None:
        """What was due is being done at `now`: on to the next time."""
        if self.frequency <= 0.0:
            return
        self._count += 1
        self.due = self._anchor + self._count / self.frequency
        if now > self.due + EPSILON_S:
            self._anchor, self._count = now, 1
            self.due = now + 1.0 / self.frequency

    def resume(self, now: float) -> None:
        """What the last time set off ended only at `now`: on time, at once, or, more than a period late, from now on."""
        if now > self.due + self.period + EPSILON_S:
            self.restart(now)
