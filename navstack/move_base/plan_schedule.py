"""When to request a plan, and when the patience with the global planner ends.

Source: move_base/src/move_base.cpp (planThread).
"""

from __future__ import annotations

import math

from navstack.move_base.schedule import EPSILON_S, Schedule
from navstack.parameters.models.move_base import MoveBaseParams


class PlanSchedule:
    """Requests plans on demand and at planner_frequency; counts failures against planner_patience and max_planning_retries."""

    def __init__(self, params: MoveBaseParams) -> None:
        self.params = params
        self._replan = Schedule(params.planner_frequency)
        self._running = False
        self._woken = False
        self._failures = 0
        self._last_valid = 0.0

    @property
    def due(self) -> float:
        """Time of the next request (s)."""
        return self._replan.due if self._running else math.inf

    def wake(self, now: float) -> None:
        """Request a plan in this tick, then at planner_frequency."""
        del now
        self._woken = self._running = True

    def stop(self, now: float) -> None:
        """Stop requests."""
        del now
        self._woken = self._running = False

    def take_request(self, now: float) -> bool:
        """Return True if a plan must be requested at `now` (s); the next request is due one period later."""
        if self._woken:
            self._replan.restart(now)
        elif not (self._running and self._replan.is_due(now)):
            return False
        self._woken = False
        self._replan.advance(now)
        return True

    def succeed(self) -> None:
        """Record a plan: it also answers requests made while the planner was busy. Stops requests without a frequency."""
        self._woken = False
        if self.params.planner_frequency <= 0.0:
            self._running = False

    def fail(self, now: float) -> bool:
        """Record a failure at `now` (s); return True if patience or retries are exhausted."""
        self._failures += 1
        limit = self.params.max_planning_retries
        # patience ends at the deadline itself: in C++ the answer always arrives a few ms after the cycle of the request
        return self.waited(now) >= self.params.planner_patience - EPSILON_S or 0 <= limit < self._failures

    def waited(self, now: float) -> float:
        """Return the time since the last plan or the last reset (s)."""
        return now - self._last_valid

    def reset_patience(self, now: float) -> None:
        """Restart patience and retries at `now` (s)."""
        self._last_valid = now
        self._failures = 0

    def set_params(self, params: MoveBaseParams, now: float, *, may_plan: bool) -> None:
        """Replace the parameters at `now` (s); `may_plan`: the mode is PLANNING or CONTROLLING."""
        before, self.params = self.params, params
        if params.planner_frequency != before.planner_frequency:
            self._replan.set_frequency(params.planner_frequency, now)
            # C++ wakes the planner thread: with a frequency it plans again, without one it waits
            self._running = may_plan and (self._running or params.planner_frequency > 0.0)
