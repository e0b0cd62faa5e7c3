"""Runs one recovery behaviour step by step, so that cancels, new goals and silent sensors are seen meanwhile (parity 22)."""

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

Tell = Callable[[RecoveryBehavior, RecoveryStatus, str, dict[str, Any], float], None]
"""Tells whoever listens how a recovery goes: which, its status, a text, data, the time (s)."""


class Ended(NamedTuple):
    """A recovery is over."""

    recovery: RecoveryBehavior
    status: RecoveryStatus
    text: str
    data: dict[str, Any]
    error: NavError | None
    """Why it failed."""


class RecoveryRunner:
    """The recovery that runs, if any: when its next step is due, and the steps themselves."""

    def __init__(self, tell: Tell, frequency: float, time_limit_s: float) -> None:
        """`frequency` (Hz): how often at least one looks for cancels; a recovery that runs longer than the limit has failed."""
        self.time_limit_s = time_limit_s
        self.running: RecoveryBehavior | None = None
        self.began = 0.0
        self._tell = tell
        self._frequency = frequency
        self._steps = Schedule(frequency)
        self._polls = Schedule(frequency)

    @property
    def due(self) -> float:
        """When there is something to do next, s."""
        return min(self._steps.due, self._polls.due) if self.running is not None else math.inf

    def set_frequency(self, frequency: float, now: float) -> None:
        """Looks for cancels so many times a second (Hz) from `now` (s) on."""
        self._frequency = frequency
        self._polls = Schedule(frequency, now)

    def start(self, recovery: RecoveryBehavior, context: RecoveryContext, now: float) -> Ended | None:
        """Starts it; its first step is due at once. What it came to, when it cannot."""
        self.running = recovery
        self.began = now
        self._steps = Schedule(recovery.frequency or self._frequency, now)
        self._polls = Schedule(self._frequency, now)
        self._polls.advance(now)
        self._steps.advance(now)
        try:
            recovery.start(context, now)
        except Exception as exc:
            return _failed(recovery, exc if isinstance(exc, NavError) else plugin_calls.internal(recovery.name, exc))
        return None

    def drop(self) -> None:
        """Nobody is interested any more."""
        self.running = None

    def take_turn(self, now: float) -> tuple[bool, bool]:
        """Whether it is time to look for cancels, and whether a step is due (which includes the former)."""
        polled, stepped = self._polls.is_due(now), self._steps.is_due(now)
        if polled:
            self._polls.advance(now)
        if stepped:
            self._steps.advance(now)
        return polled or stepped, stepped

    def overrun(self, recovery: RecoveryBehavior, now: float) -> Ended | None:
        """What it came to, when it has run for longer than the limit."""
        if now - self.began < self.time_limit_s:
            return None
        limit = self.time_limit_s
        text = f"{recovery.name} did not end within {limit:g} s"
        return _failed(recovery, RecoveryTimeoutError(text, recovery=recovery.name))

    def step(
        self,
        recovery: RecoveryBehavior,
        state_at: Callable[[float], RobotState],
        send: Callable[[Twist2D, float], None],
        now: float,
    ) -> Ended | None:
        """One step: sends its command, or says what it came to."""
        first = now == self.began
        try:
            done = plugin_calls.recovery_step(recovery, state_at(now), now)
        except NavError as exc:
            return _failed(recovery, exc)
        if done.status is RecoveryStatus.RUNNING:
            send(done.twist, now)
            if first or done.text:
                self._tell(recovery, done.status, done.text or f"{recovery.name} begins", done.data, now)
            return None
        error: NavError | None = None
        if done.status is RecoveryStatus.FAILED:
            error = NavError(done.text or f"{recovery.name} failed", recovery=recovery.name, **done.data)
        return Ended(recovery, done.status, done.text, done.data, error)


def _failed(recovery: RecoveryBehavior, error: NavError) -> Ended:
    return Ended(recovery, RecoveryStatus.FAILED, error.message, error.as_dict(), error)
