"""Periodic schedules.

Due times are computed from an anchor and a count, so that a schedule does not drift. Late calls follow the rule of ros::Rate
(roscpp rate.cpp): less than one period late, the schedule catches up; more than that, it restarts.
"""

from __future__ import annotations

import math
from typing import Final

EPSILON_S: Final = 1e-6
"""Times that differ by less are equal: callers add steps of simulated time in floating point."""

SHIFT_S: Final = 0.002
"""Largest shift of a schedule to a later time that it approaches (s)."""
BACK_S: Final = 0.00005
"""Largest shift to an earlier time (s): 1 in 40 times may come later than the schedule."""
NEAR_S: Final = 0.005
"""A due time that differs from the one that is wanted by more (s) moves at once; times that scatter by more are no reason to."""
SCAN_MARGIN_S: Final = 0.001
"""The costmap is updated this long (s) after a scan, the command follows after as much again."""


class Schedule:
    """Due at `anchor + k / frequency`; never due with the frequency 0."""

    __slots__ = ("_anchor", "_count", "_wanted", "due", "frequency")

    def __init__(self, frequency: float, now: float = 0.0) -> None:
        """Create a schedule that is due at `now` (s), then every 1 / `frequency` (Hz)."""
        self.frequency = frequency
        self._anchor = now
        self._count = 0
        self._wanted = math.inf
        """Time (s) of the last `approach`."""
        self.due = now if frequency > 0.0 else math.inf
        """Next due time (s); inf for never."""

    @property
    def period(self) -> float:
        """Time between two due times (s); inf for never."""
        return 1.0 / self.frequency if self.frequency > 0.0 else math.inf

    def is_due(self, now: float) -> bool:
        """Return True at and after the due time."""
        return now >= self.due - EPSILON_S

    def restart(self, now: float) -> None:
        """Make the schedule due at `now` (s), and count from there."""
        if self.frequency > 0.0:
            self._anchor = self.due = now
            self._count = 0

    def set_frequency(self, frequency: float, now: float) -> None:
        """Change the frequency (Hz) and make the schedule due at `now` (s); the current frequency changes nothing."""
        if frequency != self.frequency:
            self.frequency = frequency
            self.due = math.inf
            self.restart(now)

    def advance(self, now: float) -> None:
        """Set the next due time, for a call at `now` (s)."""
        if self.frequency <= 0.0:
            return
        self._count += 1
        self.due = self._anchor + self._count / self.frequency
        if now > self.due + EPSILON_S:
            self._anchor, self._count = now, 1
            self.due = now + 1.0 / self.frequency

    def approach(self, time: float) -> None:
        """Shift the schedule so that `time` (s), which comes about regularly, plus some periods becomes a due time.

        Nothing moves if the time since the last call is no multiple of the period, nor the other way round. A schedule that is
        far off is due earlier once. Otherwise it moves by up to `SHIFT_S` to a later time, and by `BACK_S` to an earlier one:
        of times that scatter, the late ones count.
        """
        period = self.period
        interval, self._wanted = time - self._wanted, time
        step, longer = sorted((interval, period))
        if step <= 0.0 or longer == math.inf:
            return
        misfit = abs(math.remainder(longer, step))
        ahead = self.due - time
        error = math.remainder(-ahead, step)
        if misfit <= NEAR_S and abs(error) <= NEAR_S:
            shift = max(-BACK_S, min(SHIFT_S, error))
        elif misfit <= SHIFT_S and ahead > 0.0:  # one that is overdue is late anyway
            shift = -(ahead % step)
        else:
            return
        self._anchor += shift
        self.due += shift

    def hasten(self, time: float) -> None:
        """Make the schedule due at `time` (s) once more, before its next due time, which remains."""
        if time < self.due < math.inf:
            self.due = time
            self._count -= 1

    def resume(self, now: float) -> None:
        """Restart at `now` (s), the end of a long call, if that is more than one period late."""
        if now > self.due + self.period + EPSILON_S:
            self.restart(now)
