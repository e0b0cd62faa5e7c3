"""The velocity commands sent to the robot."""

from __future__ import annotations

import math
from typing import Final

from navstack.core import Twist2D
from navstack.core.errors import NavError
from navstack.move_base import plugin_calls
from navstack.move_base.navigation import Navigation
from navstack.move_base.states import NavEvent

ZERO: Final = Twist2D()


class CommandOutput:
    """Sends commands to the robot; an error of the robot is published once and ends the goal after the tick."""

    def __init__(self, navigation: Navigation) -> None:
        self.last = ZERO
        """The last command."""
        self.error: NavError | None = None
        """The first error of the robot since the goal was accepted."""
        self.time = -math.inf
        """Time of the last command (s)."""
        self._navigation = navigation

    def send(self, twist: Twist2D, now: float) -> None:
        """Send a command at `now` (s)."""
        navigation = self._navigation
        self.last = navigation.last_tick.command = twist
        self.time = now
        try:
            plugin_calls.send_command(navigation.robot, twist)
        except NavError as exc:
            if self.error is None:
                self.error = exc
                text = f"the robot rejected the command {tuple(twist)}: {exc.message}"
                navigation.events.warn(now, text, exc)

    def abort_after_error(self, now: float) -> None:
        """End the active goal if the robot has rejected a command."""
        if self.error is not None and self._navigation.goal is not None:
            self._navigation.apply(NavEvent.DRIVER_FAILED, now, self.error)

    def stop(self, now: float) -> None:
        """Send zero velocity."""
        self.send(ZERO, now)

    def stop_if_moving(self, now: float) -> None:
        """Send zero velocity unless it was the last command."""
        if self.last != ZERO:
            self.send(ZERO, now)
