"""The velocity commands sent to the robot."""

from __future__ import annotations

import math
from typing import Final

from navstack.core import Twist2D
from navstack.core.errors import NavError
from navstack.move_base import plugin_calls
from navstack.move_base.navigation import Navigation
from navstack.move_base.states import NavEvent
from navstack.safety import CommandChain
from navstack.safety.chain import NAVIGATION

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
        robot = navigation.robot
        self._chain = robot if isinstance(robot, CommandChain) else None
        """What stands between the commands and the robot."""

    @property
    def executed(self) -> Twist2D:
        """The command that the robot executes for the navigation: after the chain, zero while another source drives it."""
        if self._chain is None:
            return self.last
        step = self._chain.last
        is_own = step is not None and step.source == self._chain.multiplexer.resolve(NAVIGATION)
        return step.sent if step is not None and is_own and step.is_sent else ZERO

    @property
    def due(self) -> float:
        """Next time (s) at which `flush` has work; inf without a chain."""
        return math.inf if self._chain is None else self._chain.due

    def begin(self, now: float) -> None:
        """Tell the chain the time (s) of the commands that follow."""
        if self._chain is not None:
            self._chain.begin(now)

    def flush(self, now: float) -> None:
        """Let the chain pass commands on to the robot at `now` (s)."""
        if self._chain is not None:
            self._pass_costmaps(self._chain, now)
            try:
                plugin_calls.call(self._chain, self._chain.tick, now)
            except NavError as exc:
                self._report(exc, now)

    def _pass_costmaps(self, chain: CommandChain, now: float) -> None:
        """Pass the costmaps that the tick has updated to the collision monitor."""
        navigation = self._navigation
        tick = navigation.last_tick
        if tick.local_window is not None:
            chain.observe_costmap("local_costmap", navigation.local_costmap.master, now)
        if tick.global_window is not None:
            chain.observe_costmap("global_costmap", navigation.global_costmap.master, now)

    def halt(self, now: float) -> None:
        """Stop the robot at once, without a ramp of the chain."""
        if self._chain is not None:
            try:
                plugin_calls.call(self._chain, self._chain.halt, now)
            except NavError as exc:
                self._report(exc, now)

    @property
    def has_sources(self) -> bool:
        """True if a multiplexer chooses between the sources of commands."""
        return self._chain is not None

    def send(self, twist: Twist2D, now: float, source: str = NAVIGATION) -> None:
        """Send a command at `now` (s); `source` names its input of the multiplexer (`navigation`, `motion`, `teleop`)."""
        navigation = self._navigation
        self.last = navigation.last_tick.command = twist
        self.time = now
        try:
            if self._chain is not None and source != NAVIGATION:
                plugin_calls.call(self._chain, self._chain.send, source, twist, now)
            else:
                plugin_calls.send_command(navigation.robot, twist)
        except NavError as exc:
            self._report(exc, now)

    def _report(self, exc: NavError, now: float) -> None:
        """Publish and keep the first error of the robot since the goal was accepted."""
        if self.error is None:
            self.error = exc
            text = f"the robot rejected the command {tuple(self.last)}: {exc.message}"
            self._navigation.events.warn(now, text, exc)

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
