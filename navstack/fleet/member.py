"""The run of one robot of a fleet: that of a robot alone, advanced with all others."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final, Protocol

from navstack.core import Event, Pose2D
from navstack.fleet.drive import GuidedDrive
from navstack.fleet.fleet import FleetRobot
from navstack.scenario import Run
from navstack.sim import SimulatedRobot

STANDING: Final = 0.01
"""Below this velocity a robot stands (m/s, rad/s)."""
NEVER: Final = 2**62
"""Step of the next control cycle of a robot that has nothing to do."""


class Together(Protocol):
    """All robots of a fleet."""

    def step(self) -> bool:
        """Advance to the next event; return False when the fleet is done."""
        ...


@dataclass(frozen=True, slots=True)
class Wait:
    """A robot was not granted to drive on."""

    robot: str
    begin: float
    """s."""
    end: float
    reason: str


class MemberRun(Run):
    """The run of one robot of a fleet. `step` advances the whole fleet until this robot has had its next control cycle."""

    def __init__(self, fleet: Together, member: FleetRobot, robot: SimulatedRobot, **options: Any) -> None:
        super().__init__(member.scenario, robot=robot, **options)
        self.fleet, self.name = fleet, member.name
        self.priority = member.priority
        self.due = 0
        """Physics step of the next control cycle."""
        self.cycles = 0
        self.waiting_s = 0.0
        self.finished_s = 0.0
        self.dead = False
        self.silent_until = -math.inf
        self.fault = ""
        self.waits: list[Wait] = []
        self.waits_since: float | None = None
        self.wait_reason = ""

    def step(self) -> bool:
        """Advance the fleet to the next control cycle of this robot; return False when the fleet is done."""
        before = self.cycles
        while self.cycles == before:
            if not self.fleet.step():
                return False
        return True

    def cycle(self) -> None:
        """Carry out the cycle that is due."""
        began = self._cycle_began
        self.end_cycle()
        self.cycles += 1
        if self._stands() and self.goals.under_way:
            self.waiting_s += self.robot.time - began

    def _stands(self) -> bool:
        velocity = self.robot.state().velocity
        return math.hypot(velocity.vx, velocity.vy) < STANDING and abs(velocity.wz) < STANDING

    def tell(self, text: str, data: dict[str, Any] | None = None, *, kind: str = "info") -> None:
        """Write an event into the record."""
        for listener in self.move_base.listeners:
            listener.on_event(Event(self.robot.time, kind, text, data or {}))

    @property
    def believed_pose(self) -> Pose2D:
        """Where it believes to be, in the map."""
        robot = self.robot
        return robot.frames.lookup(robot.map_frame, robot.odom_frame).apply(robot.state().pose)

    @property
    def is_idle(self) -> bool:
        """True while it has nothing to do."""
        return self.due == NEVER

    @property
    def guided(self) -> GuidedDrive | None:
        """The drive to a node of the route graph that is under way."""
        running = self.move_base.motions.running
        motion = None if running is None else running.motion
        return motion if isinstance(motion, GuidedDrive) else None
