"""The command multiplexer: of several sources of commands, the one with the highest priority drives the robot.

Behavior and parameters: twist_mux; deliberate differences: the parity page of the documentation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from navstack.core import InputError, Twist2D
from navstack.parameters import MuxInputParams, MuxLockParams, TwistMuxParams

STOP: Final = Twist2D()
_ROUNDING_S: Final = 1e-9
_AFTER_S: Final = 2e-7
"""How long after a timeout the next step is due: at the timeout itself, an input is still alive."""


@dataclass(slots=True)
class _Input:
    """An input and its last command."""

    params: MuxInputParams
    received_at: float = -math.inf
    twist: Twist2D = STOP

    def is_alive(self, now: float) -> bool:
        """True until `timeout` after the last command; false for an input that never spoke."""
        if self.received_at == -math.inf:
            return False
        timeout = self.params.timeout
        return timeout == 0.0 or now - self.received_at <= timeout + _ROUNDING_S


@dataclass(slots=True)
class _Lock:
    """A lock and its last message."""

    params: MuxLockParams
    received_at: float = -math.inf
    value: bool = False

    def is_active(self, now: float) -> bool:
        """True if it was set last, or if it must be received regularly and was not."""
        timeout = self.params.timeout
        return self.value or (timeout > 0.0 and now - self.received_at > timeout + _ROUNDING_S)


class CommandMultiplexer:
    """Passes the commands of the active input on, and stops the robot once when it becomes silent or locked."""

    def __init__(self, params: TwistMuxParams) -> None:
        self.params = params
        self._inputs = {entry.name: _Input(entry) for entry in params.topics}
        self._locks = {entry.name: _Lock(entry) for entry in params.locks}
        self._by_priority = sorted(self._inputs.values(), key=lambda one: -one.params.priority)  # stable: ties in order
        self._driving: str | None = None
        """The input whose command was passed on last; None after a stop."""
        self._stepped_at = -math.inf

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs, in the order of the parameters."""
        return tuple(self._inputs)

    def resolve(self, source: str) -> str:
        """Return the name of the input for a source: its own name, its topic, or one of its `ALIASES`. Raises InputError."""
        found = self.params.input_of(source)
        if found is not None:
            return found.name
        known = ", ".join(self._inputs)
        raise InputError(
            f'the multiplexer has no input "{source}" (it has: {known}); add an entry with this name to twist_mux/topics',
            source=source,
            known=list(self._inputs),
        )

    def active(self, now: float) -> str | None:
        """Return the input that may drive the robot at `now` (s): alive, not locked, of the highest priority; None if none."""
        barrier = self.barrier(now)
        for one in self._by_priority:
            if one.params.priority < barrier:
                break
            if one.is_alive(now):
                return one.params.name
        return None

    def barrier(self, now: float) -> int:
        """Return the highest priority of the active locks; 0 without one."""
        return max((lock.params.priority for lock in self._locks.values() if lock.is_active(now)), default=0)

    def command(self, source: str, twist: Twist2D, now: float) -> Twist2D | None:
        """Take a command of a source at `now` (s); return it if this input drives the robot, None if another one does.

        Raises InputError for an unknown source and for a command that is not finite.
        """
        if not twist.is_finite():
            raise InputError(f"the command {tuple(twist)} of {source} is not finite", source=source, command=twist)
        name = self.resolve(source)
        one = self._inputs[name]
        one.received_at, one.twist = now, twist
        if self.active(now) != name:
            return None
        self._driving = name
        return twist

    def set_lock(self, name: str, value: bool, now: float) -> None:
        """Set or release a lock at `now` (s). Raises InputError for an unknown lock."""
        lock = self._locks.get(name)
        if lock is None:
            known = ", ".join(self._locks) or "none"
            raise InputError(
                f'the multiplexer has no lock "{name}" (it has: {known})', lock=name, known=list(self._locks)
            )
        lock.value, lock.received_at = value, now

    def step(self, now: float) -> Twist2D | None:
        """Return a stop, once, if the input that drove the robot is silent or locked at `now` (s) and no other one drives."""
        self._stepped_at = now
        if self._driving is None or self.active(now) == self._driving:
            return None
        self._driving = None
        return STOP

    @property
    def due(self) -> float:
        """Time at which the input that drives the robot times out, or a lock does (s); inf if none does."""
        if self._driving is None:
            return math.inf
        one = self._inputs[self._driving]
        times = [one.received_at + one.params.timeout] if one.params.timeout > 0.0 else []
        expiries = (
            lock.received_at + lock.params.timeout for lock in self._locks.values() if lock.params.timeout > 0.0
        )
        # a lock that had expired at the last step has been looked at
        times += [time for time in expiries if time + _AFTER_S > self._stepped_at]
        return min(times, default=math.inf) + _AFTER_S

    def why_not(self, source: str, now: float) -> str:
        """Return why commands of a source do not drive the robot at `now` (s), empty if they do."""
        name = self.resolve(source)
        active = self.active(now)
        if active == name:
            return ""
        barrier = self.barrier(now)
        priority = self._inputs[name].params.priority
        if priority < barrier:
            locks = ", ".join(n for n, lock in self._locks.items() if lock.is_active(now))
            return f"{name} (priority {priority}) is locked by {locks} (priority {barrier})"
        if active is None:
            return f"{name} is silent"
        return f"{active} (priority {self._inputs[active].params.priority}) drives instead of {name} ({priority})"
