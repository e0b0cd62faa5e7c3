"""Planning beside driving: a request now, an answer when the planner would have it.

In a simulation `InlinePlanning` answers at the same tick, or as much later as the scenario says, so that slow planners can
be studied and a run stays a pure function.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple, Protocol

from navstack.core import Costmap, Footprint, Pose2D
from navstack.core.errors import NavError
from navstack.interfaces import GlobalPlanner, Plan
from navstack.move_base import plugin_calls


class PlanAnswer(NamedTuple):
    """What came of a request."""

    goal_id: str
    requested_at: float
    """s"""
    plan: Plan | None
    error: NavError | None
    """Why there is no plan."""


class PlanRequest(NamedTuple):
    """A plan that is asked for at `at` (s), for the goal of that id."""

    planner: GlobalPlanner
    costmap: Costmap
    start: Pose2D
    goal: Pose2D
    footprint: Footprint
    goal_id: str
    at: float

    def carry_out(self) -> Plan:
        """Plans; raises NavError, whatever the planner does."""
        return plugin_calls.make_plan(self.planner, self.costmap, self.start, self.goal, self.footprint)

    def answer(self, plan: Plan | None = None, error: NavError | None = None) -> PlanAnswer:
        """What came of it."""
        return PlanAnswer(self.goal_id, self.at, plan, error)


class Planning(Protocol):
    """Something that plans, one request at a time."""

    @property
    def is_busy(self) -> bool:
        """True between a request and its answer."""
        ...

    @property
    def due(self) -> float:
        """When an answer may be there (s); inf when nobody asked."""
        ...

    def request(self, request: PlanRequest) -> None:
        """Asks for a plan; not while busy."""
        ...

    def poll(self, now: float) -> PlanAnswer | None:
        """The answer, once."""
        ...

    def abandon(self) -> None:
        """Nobody waits for the answer any more."""
        ...

    def is_using(self, planner: GlobalPlanner) -> bool:
        """True while that planner is at work, be it on a plan that nobody waits for."""
        ...


class InlinePlanning:
    """Plans at once on the costmap of that moment; the answer arrives `planning_time` (s) later."""

    def __init__(self, planning_time: float | Callable[[float], float] = 0.0) -> None:
        """`planning_time`: seconds, or a function of the time of the request (s) that gives them; inf for never."""
        self._planning_time = planning_time
        self._answer: PlanAnswer | None = None
        self._due = math.inf

    @property
    def is_busy(self) -> bool:
        """True between a request and its answer."""
        return self._answer is not None

    @property
    def due(self) -> float:
        """When the answer arrives (s)."""
        return self._due

    def request(self, request: PlanRequest) -> None:
        """Plans now."""
        try:
            answer = request.answer(request.carry_out())
        except NavError as exc:
            answer = request.answer(error=exc)
        takes = self._planning_time
        self._answer = answer
        self._due = request.at + (takes(request.at) if callable(takes) else takes)

    def poll(self, now: float) -> PlanAnswer | None:
        """The answer, once its time has come."""
        answer = self._answer
        if answer is None or now < self._due - 1e-6:
            return None
        self._answer = None
        self._due = math.inf
        return answer

    def abandon(self) -> None:
        """Forgets the request."""
        self._answer = None
        self._due = math.inf

    def is_using(self, planner: GlobalPlanner) -> bool:
        """Never between two calls."""
        del planner
        return False
