"""When the global planner is asked for a plan, and for how long it is borne with.

Source: move_base/src/move_base.cpp (planThread).
"""

from __future__ import annotations

import math

from navstack.move_base.schedule import EPSILON_S, Schedule
from navstack.parameters.models.move_base import MoveBaseParams


class PlanSchedule:
    """Wakes the planner, replans at planner_frequency, and counts failures against patience and retries."""

    def __init__(self, params: MoveBaseParams) -> None:
        self.params = params
        self._replan = Schedule(params.planner_frequency)
        self._on = False
        self._woken = False
        self._failures = 0
        self._last_valid = 0.0

    @property
    def due(self) -> float:
        """When the planner is to be asked next, s."""
        return self._replan.due if self._on else math.inf

    def wake(self) -> None:
        """Plan now, and from there on."""
        self._woken = self._on = True

    def stop(self) -> None:
        """Plan no more."""
        self._woken = self._on = False

    def take_turn(self, now: float) -> bool:
        """True when the planner is to be asked at `now` (s); the next time is then one period on."""
        if self._woken:
            self._replan.restart(now)
        elif not (self._on and self._replan.is_due(now)):
            return False
        self._woken = False
        self._replan.advance(now)
        return True

    def found(self) -> None:
        """There is a plan: whoever woke the planner while it was busy has it, and without a frequency it rests."""
        self._woken = False
        if self.params.planner_frequency <= 0.0:
            self._on = False

    def failed(self, now: float) -> bool:
        """Takes down a failure at `now` (s); True when patience or retries are used up."""
        self._failures += 1
        limit = self.params.max_planning_retries
        # at the deadline itself patience is over: in C++ the answer always comes a few ms after the cycle that asked
        return self.waited(now) >= self.params.planner_patience - EPSILON_S or 0 <= limit < self._failures

    def waited(self, now: float) -> float:
        """S since there last was a plan, or since patience started anew."""
        return now - self._last_valid

    def reset_patience(self, now: float) -> None:
        """Patience and retries start anew at `now` (s)."""
        self._last_valid = now
        self._failures = 0

    def set_params(self, params: MoveBaseParams, now: float, *, may_plan: bool) -> None:
        """From the next turn on; `may_plan`: the goal manager is PLANNING or CONTROLLING."""
        before, self.params = self.params, params
        if params.planner_frequency != before.planner_frequency:
            self._replan = Schedule(params.planner_frequency, now)
            # C++ wakes the planner thread: with a frequency it plans again, without it waits
            self._on = may_plan and (self._on or params.planner_frequency > 0.0)
