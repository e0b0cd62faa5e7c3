"""Planning while driving: a request, and its answer in the same or a later tick.

In a simulation `InlinePlanning` answers in the same tick, or after the planning time of the scenario, so that slow planners
can be studied and a run remains a pure function.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple, Protocol

from navstack.core import Costmap, Footprint, Pose2D
from navstack.core.errors import NavError
from navstack.interfaces import GlobalPlanner, Plan
from navstack.move_base import plugin_calls
from navstack.move_base.schedule import EPSILON_S


class PlanAnswer(NamedTuple):
    """The answer to a request."""

    goal_id: str
    requested_at: float
    """s"""
    plan: Plan | None
    error: NavError | None
    """Reason of a failure; None with a plan."""


class PlanRequest(NamedTuple):
    """A request at the time `at` (s) for a plan to the goal of that id."""

    planner: GlobalPlanner
    costmap: Costmap
    start: Pose2D
    goal: Pose2D
    footprint: Footprint
    goal_id: str
    at: float
    keep_potential: bool = False
    """Whether the plan is to have its potential."""

    def carry_out(self) -> Plan:
        """Plan. Raises NavError for any exception of the planner."""
        return plugin_calls.make_plan(
            self.planner, self.costmap, self.start, self.goal, self.footprint, keep_potential=self.keep_potential
        )

    def answer(self, plan: Plan | None = None, error: NavError | None = None) -> PlanAnswer:
        """Return the answer to this request."""
        return PlanAnswer(self.goal_id, self.at, plan, error)


class Planning(Protocol):
    """Executes plan requests, one at a time."""

    @property
    def is_busy(self) -> bool:
        """True between a request and its answer."""
        ...

    @property
    def due(self) -> float:
        """Time at which an answer may be available (s); inf without a request."""
        ...

    def request(self, request: PlanRequest) -> None:
        """Request a plan; not allowed while busy."""
        ...

    def poll(self, now: float) -> PlanAnswer | None:
        """Return the answer once it is available, and clear it."""
        ...

    def abandon(self) -> None:
        """Discard the pending request."""
        ...

    def is_using(self, planner: GlobalPlanner) -> bool:
        """Return True while that planner computes a plan, including that of a discarded request."""
        ...


class InlinePlanning:
    """Plans at once on the present costmap; the answer is available `planning_time` (s) later."""

    def __init__(self, planning_time: float | Callable[[float], float] = 0.0) -> None:
        """Set the planning time (s): a number, or a function of the time of the request (s); inf for never."""
        self._planning_time = planning_time
        self._answer: PlanAnswer | None = None
        self._due = math.inf

    @property
    def is_busy(self) -> bool:
        """True between a request and its answer."""
        return self._answer is not None

    @property
    def due(self) -> float:
        """Time at which the answer is available (s)."""
        return self._due

    def request(self, request: PlanRequest) -> None:
        """Plan now."""
        try:
            answer = request.answer(request.carry_out())
        except NavError as exc:
            answer = request.answer(error=exc)
        duration = self._planning_time
        self._answer = answer
        self._due = request.at + (duration(request.at) if callable(duration) else duration)

    def poll(self, now: float) -> PlanAnswer | None:
        """Return the answer once its time has come, and clear it."""
        answer = self._answer
        if answer is None or now < self._due - EPSILON_S:
            return None
        self._answer = None
        self._due = math.inf
        return answer

    def abandon(self) -> None:
        """Discard the pending request."""
        self._answer = None
        self._due = math.inf

    def is_using(self, planner: GlobalPlanner) -> bool:
        """Return False: a plan is complete before `request` returns."""
        del planner
        return False
