"""Runs one behavior step by step: recoveries and motions of the goal manager, tasks, and nodes that only move the robot."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable
from typing import Any, Final, NamedTuple, Protocol

from navstack.core import NavError, RobotState, Twist2D
from navstack.plugins import (
    Behavior,
    BehaviorContext,
    BehaviorStatus,
    BehaviorStep,
    CommandLimits,
    broken_contract,
    own_speeds,
    shown,
)

FASTEST_HZ: Final = 1000.0
"""Highest rate of the steps of a behavior."""
Guard = Callable[..., Any]
"""Calls a method of a plugin: `guard(plugin, method, *arguments)`. Raises a NavError for whatever the method raises."""


class Pace(Protocol):
    """When steps are due."""

    due: float
    """Next due time (s); inf for never."""

    def is_due(self, now: float) -> bool:
        """Return True at and after the due time."""
        ...

    def advance(self, now: float) -> None:
        """Set the next due time, for a step at `now` (s)."""
        ...


class BehaviorEnd(NamedTuple):
    """The end of a behavior."""

    behavior: Behavior
    step: BehaviorStep | None
    """The last step; None if it raised an error."""
    error: NavError | None
    """Reason of a failure."""

    @property
    def status(self) -> BehaviorStatus:
        """DONE or FAILED."""
        return BehaviorStatus.FAILED if self.step is None else self.step.status

    @property
    def text(self) -> str:
        """What was done, or why it failed."""
        if self.step is not None:
            return self.step.text
        return "" if self.error is None else self.error.message

    @property
    def data(self) -> dict[str, Any]:
        """The figures of the last step, or the error as JSON data."""
        if self.step is not None:
            return self.step.data
        return {} if self.error is None else self.error.as_dict()


def unguarded(plugin: object, method: Callable[..., Any], *arguments: Any) -> Any:
    """Call a method of a behavior whose errors need no translation."""
    del plugin
    return method(*arguments)


class BehaviorRunner:
    """The running behavior, if any, and the pace of its steps.

    The owner says when it starts, steps and drops one, and sends the commands: nothing here waits or reads a clock. Whatever a
    behavior raises or returns under a guard, it goes on or has a `BehaviorEnd`.
    """

    def __init__(self, make_pace: Callable[[float, float], Pace], guard: Guard = unguarded) -> None:
        """`make_pace` returns a pace for a frequency (Hz), whose first step is due at a time (s)."""
        self.running: Behavior | None = None
        self.started_at = 0.0
        """s."""
        self._make_pace = make_pace
        self._guard = guard
        self._pace: Pace | None = None
        self._limits: CommandLimits | None = None
        self._own_speeds = 0.0, 0.0
        """What the parameters of the running behavior allow (m/s, rad/s)."""

    @property
    def due(self) -> float:
        """Time of the next step (s); inf without a behavior."""
        return self._pace.due if self.running is not None and self._pace is not None else math.inf

    def is_due(self, now: float) -> bool:
        """Return True if a step is due at `now` (s)."""
        return self.running is not None and self._pace is not None and self._pace.is_due(now)

    def advance(self, now: float) -> None:
        """Set the time of the next step, for one at `now` (s)."""
        if self._pace is not None:
            self._pace.advance(now)

    def start(
        self, behavior: Behavior, context: BehaviorContext, now: float, frequency: float, *, check: bool = False
    ) -> BehaviorEnd | None:
        """Start a behavior, whose first step is due at `now` (s); return its end if it fails to start.

        `frequency` (Hz) is that of a behavior without its own. With `check`, its parameters are checked first.
        """
        self.running, self.started_at, self._pace = behavior, now, None
        try:
            if check:
                self._guard(behavior, behavior.check, context)
            self._guard(behavior, behavior.start, context, now)
            own: Any = self._guard(behavior, lambda: behavior.frequency)
            if own is not None and not (isinstance(own, (int, float)) and 0.0 <= own <= FASTEST_HZ):
                problem = f"has a frequency of {shown(own)}, which is no rate of at most {FASTEST_HZ:g} Hz"
                raise broken_contract(behavior, problem)
        except NavError as exc:
            return self.failure(exc)
        self._own_speeds = own_speeds(behavior.params)
        if not context:  # a motion without move_base, which sets its own speeds
            self._limits = None
        elif self._limits is None or self._limits.planner is not context.local_planner:
            self._limits = CommandLimits(context.local_planner)
        self._pace = self._make_pace(own or frequency, now)
        return None

    def step(self, state_at: Callable[[float], RobotState], now: float) -> BehaviorStep | BehaviorEnd:
        """Execute one step at `now` (s), with the robot's state in the local costmap's frame; return it, or the end.

        An error of `state_at` ends the behavior, too.
        """
        behavior = self.running
        assert behavior is not None
        try:
            state = state_at(now)
            step = _valid_step(behavior, self._guard(behavior, behavior.step, state, now))
            if self._limits is not None and step.status is BehaviorStatus.RUNNING:
                self._limits.check(behavior, step.twist, state.velocity, self._own_speeds)
        except NavError as exc:
            return self.failure(exc)
        if step.status is BehaviorStatus.RUNNING:
            return step
        error: NavError | None = None
        if step.status is BehaviorStatus.FAILED:
            error = NavError(step.text or f"{behavior.name} failed")
            error.data = {**step.data, "recovery": behavior.name}
        return BehaviorEnd(behavior, step, error)

    def failure(self, error: NavError) -> BehaviorEnd:
        """Return the end of the running behavior by an error."""
        assert self.running is not None
        return BehaviorEnd(self.running, None, error)

    def drop(self, now: float) -> None:
        """Abandon the running behavior."""
        del now
        behavior, self.running = self.running, None
        if behavior is not None:
            with contextlib.suppress(NavError):  # its result stands
                self._guard(behavior, behavior.release)


def _valid_step(behavior: Behavior, step: Any) -> BehaviorStep:
    """Return a step with a finite command. Raises InternalError."""
    problem = ""
    if not isinstance(step, BehaviorStep):
        problem = f"returned a {type(step).__name__}, not a BehaviorStep"
    elif not _is_command(step.twist):
        problem = f"commands {step.twist}, which is not a Twist2D of three finite numbers"
    else:
        fields: tuple[Any, Any, Any] = (step.status, step.text, step.data)
        status, text, data = fields
        if not isinstance(status, BehaviorStatus) or not isinstance(text, str):
            problem = f"returned a step with the status {shown(status)} and a text of type {type(text).__name__}"
        elif not isinstance(data, dict) or not all(isinstance(key, str) for key in data):
            problem = f"returned a step with data {shown(data)}, not a dictionary with names as keys"
    if problem:
        raise broken_contract(behavior, problem)
    return step


def _is_command(twist: Any) -> bool:
    try:
        return isinstance(twist, Twist2D) and twist.is_finite()
    except TypeError:  # a component is not a number
        return False
