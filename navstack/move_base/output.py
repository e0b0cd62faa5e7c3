"""The velocity commands sent to the robot."""

from __future__ import annotations

import math
from typing import Final

from navstack.core import NavError, Twist2D
from navstack.move_base.events import EventPublisher, TickResult
from navstack.move_base.plugin_calls import call
from navstack.plugins import CostmapServer, Robot
from navstack.safety import NAVIGATION, CommandChain

ZERO: Final = Twist2D()


class CommandOutput:
    """Sends commands to the robot. An error of the robot is published once and kept: it ends the goal after the tick."""

    def __init__(
        self, robot: Robot, global_costmap: CostmapServer, local_costmap: CostmapServer, events: EventPublisher
    ) -> None:
        self.last = ZERO
        """The last command."""
        self.error: NavError | None = None
        """The first error of the robot since the goal was accepted."""
        self.time = -math.inf
        """Time of the last command (s)."""
        self.chain = robot if isinstance(robot, CommandChain) else None
        """What stands between the commands and the robot."""
        self._robot = robot
        self._costmaps = {"local_costmap": local_costmap, "global_costmap": global_costmap}
        self._events = events
        self.tick = TickResult(0.0)
        """The result of the current tick, in which the last command is kept."""

    @property
    def executed(self) -> Twist2D:
        """The command that the robot executes for the navigation: after the chain, zero while another source drives it."""
        chain = self.chain
        if chain is None:
            return self.last
        step = chain.last
        is_own = step is not None and step.source == chain.multiplexer.resolve(NAVIGATION)
        return step.sent if step is not None and is_own and step.is_sent else ZERO

    @property
    def due(self) -> float:
        """Next time (s) at which `finish` has work; inf without a chain."""
        return math.inf if self.chain is None else self.chain.due

    def begin(self, tick: TickResult) -> None:
        """Take the tick in whose result the commands that follow are kept."""
        self.tick = tick
        if self.chain is not None:
            self.chain.begin(tick.time)

    def finish(self) -> None:
        """Let the chain pass commands on to the robot, and the costmaps that the tick has updated to the collision monitor."""
        chain, tick = self.chain, self.tick
        if chain is None:
            return
        for name, window in (("local_costmap", tick.local_window), ("global_costmap", tick.global_window)):
            if window is not None:
                chain.observe_costmap(name, self._costmaps[name].master, tick.time)
        try:
            call(chain, chain.tick, tick.time)
        except NavError as exc:
            self._report(exc, tick.time)

    def send(self, twist: Twist2D, now: float, source: str = NAVIGATION) -> None:
        """Send a command at `now` (s); `source` names its input of the multiplexer (`navigation`, `motion`, `teleop`)."""
        self.last = self.tick.command = twist
        self.time = now
        try:
            if self.chain is not None and source != NAVIGATION:
                call(self.chain, self.chain.send, source, twist, now)
            else:
                call(self._robot, self._robot.command, twist)
        except NavError as exc:
            self._report(exc, now)

    def stop(self, now: float) -> None:
        """Send zero velocity."""
        self.send(ZERO, now)

    def stop_if_moving(self, now: float, source: str = NAVIGATION) -> None:
        """Send zero velocity unless it was the last command."""
        if self.last != ZERO:
            self.send(ZERO, now, source)

    def halt(self, now: float) -> None:
        """Stop the robot at once, without a ramp of the chain."""
        if self.chain is not None:
            try:
                call(self.chain, self.chain.halt, now)
            except NavError as exc:
                self._report(exc, now)

    def _report(self, exc: NavError, now: float) -> None:
        if self.error is None:
            self.error = exc
            self._events.warn(now, f"the robot rejected the command {tuple(self.last)}: {exc.message}", exc)
