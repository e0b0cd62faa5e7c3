"""The velocity commands of a simulated robot: delay and timeout, in physics steps."""

from __future__ import annotations

import math
from collections import deque

from navstack.core import Twist2D
from navstack.parameters.models.sim import SimParams

_STOP = Twist2D()


class CommandQueue:
    """Commands that take effect after the command delay; a command older than the timeout becomes a stop."""

    def __init__(self, params: SimParams) -> None:
        frequency = params.physics_frequency
        self._delay_steps = math.ceil(params.command_delay * frequency - 1e-9)
        self._timeout_steps = (
            None if params.command_timeout is None else math.ceil(params.command_timeout * frequency - 1e-9)
        )
        # (step from which it is in force, command), oldest first; the first one is in force
        self._commands: deque[tuple[int, Twist2D]] = deque([(0, _STOP)])

    @property
    def current(self) -> Twist2D:
        """The command in force."""
        return self._commands[0][1]

    def add(self, twist: Twist2D, now: int) -> None:
        """Adds a command given at step `now`."""
        step = now + self._delay_steps
        if self._commands[-1][0] == step:
            self._commands.pop()
        self._commands.append((step, twist))

    def advance(self, now: int, last: int) -> int:
        """Puts the command of step `now` in force; returns the step, at most `last`, up to which it remains in force."""
        commands = self._commands
        while len(commands) > 1 and commands[1][0] <= now:
            commands.popleft()
        until = min(last, commands[1][0]) if len(commands) > 1 else last
        if self._timeout_steps is not None:
            expiry = commands[0][0] + self._timeout_steps
            if expiry <= now:
                commands[0] = (commands[0][0], _STOP)
            else:
                until = min(until, expiry)
        return until
