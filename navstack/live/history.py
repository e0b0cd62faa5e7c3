"""What happened in a session: samples, plans, events and the driven path. Bounded, so that a long session does not grow."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import Event, LaserScan
from navstack.core.errors import jsonable
from navstack.scenario import Run

SAMPLES = 3000
EVENTS = 500
PLANS = 6
TRAIL = 2000


class Sample(NamedTuple):
    """One control cycle: time (s), clearance (m), velocities and commands (m/s, rad/s), state, steering angle (rad)."""

    t: float
    clearance: float
    vx: float
    wz: float
    command_vx: float
    command_wz: float
    state: str
    steering: float = 0.0


class NumberedEvent(NamedTuple):
    """An event and its number in the session."""

    number: int
    time: float
    kind: str
    text: str
    data: dict[str, Any]


class History:
    """A listener of the run's events that also takes a sample after each cycle."""

    hears_feedback = False

    def __init__(self) -> None:
        self.samples: deque[Sample] = deque(maxlen=SAMPLES)
        self.events: deque[NumberedEvent] = deque(maxlen=EVENTS)
        self.plans: deque[tuple[int, NDArray[np.float64]]] = deque(maxlen=PLANS)
        """Number and poses (n, 3) of the last plans, in the global frame."""
        self.trail: list[tuple[float, float]] = []
        """Positions of the robot (m, map frame), thinned out when there are too many."""
        self.scans: dict[str, LaserScan] = {}
        """The last scan of each lidar, by topic."""
        self.goals: dict[str, float] = {}
        """When each goal was sent (s), by its id, in this order."""
        self.plan_count = 0
        self.least_clearance = math.inf
        """Least clearance so far (m)."""
        self.trail_version = 0
        self._spacing = 0.05
        self._event_count = 0

    def on_event(self, event: Event) -> None:
        """Keeps an event."""
        if event.kind == "status" and "id" in event.data:
            self.goals.setdefault(str(event.data["id"]), event.time)
        number, self._event_count = self._event_count, self._event_count + 1
        self.events.append(NumberedEvent(number, event.time, event.kind, event.text, jsonable(dict(event.data))))

    @property
    def last_event(self) -> int:
        """Number of the last event, -1 without one."""
        return self.events[-1].number if self.events else -1

    def events_after(self, number: int) -> Iterator[NumberedEvent]:
        """Yields the events with a larger number."""
        return (event for event in self.events if event.number > number)

    def add(self, run: Run) -> None:
        """Takes a sample of the last cycle."""
        robot, move_base = run.robot, run.move_base
        self.least_clearance = min(self.least_clearance, robot.clearance)
        velocity = robot.state().velocity
        command = move_base.command if robot.by_hand is None else robot.by_hand
        self.samples.append(
            Sample(
                robot.time,
                robot.clearance,
                velocity.vx,
                velocity.wz,
                command.vx,
                command.wz,
                move_base.state.name,
                robot.steering_angle,
            )
        )
        for scan in move_base.last_tick.scans:
            if isinstance(scan, LaserScan):
                self.scans[scan.topic] = scan
        plan = move_base.last_tick.plan
        if plan is not None:
            self.plan_count += 1
            self.plans.append((self.plan_count, plan.path.poses))
        self._extend_trail(robot.pose.x, robot.pose.y)

    def _extend_trail(self, x: float, y: float) -> None:
        trail = self.trail
        if trail and (x - trail[-1][0]) ** 2 + (y - trail[-1][1]) ** 2 < self._spacing**2:
            return
        trail.append((x, y))
        self.trail_version += 1
        if len(trail) > TRAIL:
            del trail[1::2]
            self._spacing *= 2.0
