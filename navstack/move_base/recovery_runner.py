"""Runs one recovery behavior step by step, so that cancels, new goals and stale sensors take effect meanwhile (parity 22)."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from navstack.core import RobotState, Twist2D
from navstack.core.errors import NavError
from navstack.interfaces import RecoveryBehavior, RecoveryContext, RecoveryStatus
from navstack.move_base import plugin_calls
from navstack.move_base.errors import RecoveryTimeoutError
from navstack.move_base.schedule import Schedule

Publish = Callable[[RecoveryBehavior, RecoveryStatus, str, dict[str, Any], float], None]
"""Publishes the status of a recovery behavior: which one, its status, a text, data, the time (s)."""


class RecoveryEnd(NamedTuple):
    """The end of a recovery behavior."""

    recovery: RecoveryBehavior
    status: RecoveryStatus
    text: str
    data: dict[str, Any]
    error: NavError | None
    """Reason of a failure."""


class RecoveryRunner:
    """The running recovery behavior, if any, and its schedule."""

    def __init__(self, publish: Publish, frequency: float, time_limit_s: float) -> None:
        """Create a runner that checks for cancels at `frequency` (Hz) and fails a behavior after `time_limit_s` (s)."""
        self.time_limit_s = time_limit_s
        self.running: RecoveryBehavior | None = None
        self.started_at = 0.0
        self._publish = publish
        self._frequency = frequency
        self._steps = Schedule(frequency)
        self._checks = Schedule(frequency)

    @property
    def due(self) -> float:
        """Time of the next step or check for cancels (s)."""
        return min(self._steps.due, self._checks.due) if self.running is not None else math.inf

    def set_frequency(self, frequency: float, now: float) -> None:
        """Check for cancels at `frequency` (Hz) from `now` (s)."""
        self._frequency = frequency
        self._checks = Schedule(frequency, now)

    def start(self, recovery: RecoveryBehavior, context: RecoveryContext, now: float) -> RecoveryEnd | None:
        """Start a behavior, whose first step is due at once. Returns its end if it fails to start."""
        self.running = recovery
        self.started_at = now
        self._checks = Schedule(self._frequency, now)
        self._checks.advance(now)
        try:
            frequency = plugin_calls.start_recovery(recovery, context, now)
        except NavError as exc:
            return _failed(recovery, exc)
        self._steps = Schedule(frequency or self._frequency, now)
        self._steps.advance(now)
        return None

    def drop(self, now: float) -> None:
        """Abandon the running behavior."""
        del now
        self.running = None

    def advance(self, now: float) -> tuple[bool, bool]:
        """Return whether a check for cancels is due at `now` (s), and whether a step is; a step includes the check."""
        check, step = self._checks.is_due(now), self._steps.is_due(now)
        if check:
            self._checks.advance(now)
        if step:
            self._steps.advance(now)
        return check or step, step

    def check_time_limit(self, recovery: RecoveryBehavior, now: float) -> RecoveryEnd | None:
        """Return the behavior's end if it has run for longer than the time limit."""
        if now - self.started_at < self.time_limit_s:
            return None
        text = f"{recovery.name} did not end within {self.time_limit_s:g} s"
        return _failed(recovery, RecoveryTimeoutError(text, recovery=recovery.name))

    def step(
        self,
        recovery: RecoveryBehavior,
        state_at: Callable[[float], RobotState],
        send: Callable[[Twist2D, float], None],
        now: float,
    ) -> RecoveryEnd | None:
        """Execute one step and send its command; returns the behavior's end if this was the last step."""
        first = now == self.started_at
        try:
            step = plugin_calls.recovery_step(recovery, state_at(now), now)
        except NavError as exc:
            return _failed(recovery, exc)
        if step.status is RecoveryStatus.RUNNING:
            send(step.twist, now)
            if first or step.text:
                self._publish(recovery, step.status, step.text or f"{recovery.name} starts", step.data, now)
            return None
        error: NavError | None = None
        if step.status is RecoveryStatus.FAILED:
            error = NavError(step.text or f"{recovery.name} failed", recovery=recovery.name, **step.data)
        return RecoveryEnd(recovery, step.status, step.text, step.data, error)


def _failed(recovery: RecoveryBehavior, error: NavError) -> RecoveryEnd:
    return RecoveryEnd(recovery, RecoveryStatus.FAILED, error.message, error.as_dict(), error)
