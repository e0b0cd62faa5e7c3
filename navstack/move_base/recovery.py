"""The recovery behaviors of a goal, one after the other and step by step, and their effects afterwards (parity 22)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

from navstack.behaviors import BehaviorEnd, BehaviorRunner
from navstack.core import NavError, RobotState
from navstack.move_base.errors import RecoveryTimeoutError
from navstack.move_base.events import EventPublisher
from navstack.move_base.plugin_calls import call, checked_flag
from navstack.move_base.schedule import EPSILON_S, Schedule
from navstack.move_base.states import NavState, Trigger
from navstack.plugins import Behavior, BehaviorContext, BehaviorStatus

MAX_ROUNDS: Final = 3
"""How often the list of recoveries runs without a motion of oscillation_distance, even if the index is reset."""


class Recoveries:
    """The list of recovery behaviors: which one runs, and which ones still have effects."""

    def __init__(
        self,
        behaviors: Sequence[Behavior],
        context: BehaviorContext,
        events: EventPublisher,
        time_limit_s: float,
    ) -> None:
        """Create the list; a behavior fails after `time_limit_s` (s). Raises a ParameterError for one that does not fit."""
        self.behaviors = tuple(behaviors)
        self.time_limit_s = time_limit_s
        self.runner = BehaviorRunner(Schedule, call)
        self.followed: list[Behavior] = []
        """Ended behaviors whose effects may last, such as lowered speed limits of the local planner."""
        self._events = events
        self.check(context)
        self.context = context
        """What a behavior may act on."""
        self._checks = Schedule(context.controller_frequency)

    @property
    def running(self) -> Behavior | None:
        """The running behavior."""
        return self.runner.running

    @property
    def due(self) -> float:
        """Time of the next step or check for cancels (s)."""
        return min(self.runner.due, self._checks.due) if self.runner.running is not None else math.inf

    def check(self, context: BehaviorContext) -> None:
        """Raise a ParameterError if the parameters of a behavior do not fit `context`."""
        for behavior in self.behaviors:
            call(behavior, behavior.check, context)

    def set_context(self, context: BehaviorContext, now: float) -> None:
        """Replace what behaviors may act on; the checks for cancels follow its frequency from `now` (s)."""
        if context.controller_frequency != self.context.controller_frequency:
            self._checks = Schedule(context.controller_frequency, now)
        self.context = context

    def start(self, behavior: Behavior, now: float) -> BehaviorEnd | None:
        """Start a behavior, whose first step the caller executes at once. Returns its end if it fails to start."""
        self._checks = Schedule(self.context.controller_frequency, now)
        self._checks.advance(now)
        end = self.runner.start(behavior, self.context, now, self.context.controller_frequency)
        self.runner.advance(now)
        return end

    def advance(self, now: float) -> tuple[bool, bool]:
        """Return whether a check for cancels is due at `now` (s), and whether a step is; a step includes the check."""
        check, step = now >= self._checks.due - EPSILON_S, self.runner.is_due(now)
        if check:
            self._checks.advance(now)
        if step:
            self.runner.advance(now)
        return check or step, step

    def check_time_limit(self, behavior: Behavior, now: float) -> BehaviorEnd | None:
        """Return the behavior's end if it has run for longer than the time limit."""
        if now - self.runner.started_at < self.time_limit_s:
            return None
        text = f"{behavior.name} did not end within {self.time_limit_s:g} s"
        return self.runner.failure(RecoveryTimeoutError(text, recovery=behavior.name))

    def follow(self, behavior: Behavior) -> None:
        """Follow up on a behavior that has ended."""
        if behavior not in self.followed:
            self.followed.append(behavior)

    def follow_up(self, state: RobotState, now: float) -> None:
        """Follow up on ended behaviors whose effects last."""
        for behavior in list(self.followed):
            try:
                lasts = call(behavior, behavior.follow_up, state, now, check=checked_flag)
            except NavError as exc:
                self._events.warn(now, exc.message, exc)
                lasts = False
            if not lasts:
                self.followed.remove(behavior)

    def publish(
        self,
        behavior: Behavior,
        status: BehaviorStatus,
        text: str,
        data: dict[str, Any],
        state: NavState,
        now: float,
    ) -> None:
        """Publish the start, a message or the end of a behavior."""
        names = (behavior.name, type(behavior).__name__)
        self.publish_named(names, status, text, data, (state.recovery_index, len(self.behaviors)), state.trigger, now)

    def publish_named(
        self,
        names: tuple[str, str],
        status: BehaviorStatus,
        text: str,
        data: dict[str, Any],
        position: tuple[int, int],
        trigger: Trigger,
        now: float,
    ) -> None:
        """Publish the same of a recovery with this name and type, at its index in a list of this length (0: no list)."""
        if not self._events.listeners:
            return
        common: dict[str, Any] = {
            "name": names[0],
            "type": names[1],
            "index": position[0],
            "total": position[1],
            "status": status.value,
            "trigger": trigger.name,
        }
        self._events.publish(now, "recovery", text, {**data, **common})
