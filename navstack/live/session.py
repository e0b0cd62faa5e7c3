"""A running simulation that a person can pause, rewind and take part in. Knows nothing of the web and reads no clock.

The session drives a `Run`. What a person does becomes an interaction with the simulated time at which it was done; the
scenario with these interactions gives the same run again, so going back in time is to simulate again: from the last checkpoint
before, which is an exact copy, or from the start.
"""

from __future__ import annotations

import hashlib
import math
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import Event, InputError, Pose2D, SensorData, compile_seconds, jsonable
from navstack.explain import Replayed
from navstack.live.checkpoints import Checkpoint, Checkpoints, Origin, Twin, digest_of, snapshot
from navstack.record import RunRecorder
from navstack.scenario import INTERACTION, Drive, Run, Scenario

# ----------------------------------------------------------------------------------------------------------------------
# What happened in a session: samples, plans, events and the driven path. Bounded, so that a long session does not grow.


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
        self.readings: dict[str, SensorData] = {}
        """The last measurement of each sensor, by topic."""
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
        for data in move_base.last_tick.scans:
            self.readings[data.topic.strip("/")] = data
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


MAX_SPEED = 1000.0
"""Largest factor of real time; faster is "as fast as possible"."""
BACKLOG_S = 0.25
"""Real time that a slow session may fall behind before it drops the rest (s)."""
MAX_INTERACTIONS = 100_000
SLOW = 20.0
"""Up to this factor of real time, checkpoints are close together."""
SPACING_SLOW, SPACING_FAST = 100, 1500
"""Control cycles between two checkpoints."""
CHECK_TIME = 1e-9


class Session:
    """One robot in one world. `advance` drives it in real time; `interact` changes it."""

    only_time = "this is a recorded run: only the time can be changed; open its scenario to take part"
    """Why a page cannot take part, where that is so."""
    rewinds = True
    """Whether a page may go back in time."""
    worlds = 0
    """Grows when another world is shown: pages get everything anew."""

    def __init__(self, scenario: Scenario, *, origin: Origin | None = None, speed: float | None = 1.0) -> None:
        """`speed` is the factor of real time; None is as fast as possible."""
        self.scenario = replace(scenario, interactions=())
        self.origin = origin or Origin()
        self.interactions: list[Any] = list(scenario.interactions)
        """Everything that a person did, in order, also what is still to come after a rewind."""
        self.paused = False
        self.speed = speed
        self.end = 0.0
        """Latest time that has been simulated (s)."""
        self.changes = 0
        """Grows with everything a person does, so that pages see at once that something has changed."""
        self.restarts = 0
        """Grows with every rewind."""
        self.cycles = 0
        """Number of control cycles since the start of the run."""
        self.factor = 0.0
        """Measured factor of real time."""
        self._seek: float | None = None
        self._clock = 0.0
        self._checkpoints = Checkpoints()
        self._start()

    # --- time -------------------------------------------------------------------------------------------------------

    @property
    def time(self) -> float:
        """Simulated time (s)."""
        return self.run.robot.time

    @property
    def clock(self) -> float:
        """Simulated time that a page shows (s): it runs evenly, between the last two cycles."""
        return self.time if self.paused or self.is_done or self.speed is None else min(self._clock, self.time)

    @property
    def is_done(self) -> bool:
        """True when there is nothing left to do; an interaction continues the run."""
        return self.run.done

    @property
    def is_seeking(self) -> bool:
        """True while the session simulates up to a requested time."""
        return self._seek is not None

    def advance(
        self, elapsed_s: float, *, budget_s: float, timer: Callable[[], float], limit: float = math.inf
    ) -> bool:
        """Simulates what is due after `elapsed_s` of real time, for at most about `budget_s` (by `timer`); True if anything was.

        A session that cannot keep up gets slower; it never catches up in a rush. No cycle begins after `limit` (simulated s).
        """
        started = timer()
        if self._seek is not None:
            return self._advance_seek(started + budget_s, timer)
        if self.paused or self.is_done:
            self._clock = self.time
            self.factor = 0.0
            return False
        if self.speed is None:
            target = math.inf
        else:
            target = self._clock = min(self._clock + elapsed_s * self.speed, self.time + BACKLOG_S * self.speed)
        target = min(target, limit)
        before, compiled = self.time, compile_seconds()
        while self.time < target and self._step() and timer() < started + budget_s:
            pass
        if self.speed is None:
            self._clock = self.time
        self._measure(self.time - before, elapsed_s - (compile_seconds() - compiled))
        return self.time > before

    def pause(self, paused: bool) -> None:
        """Stops or continues the time."""
        self.paused = paused
        self._clock = self.time
        self.changes += 1

    def set_speed(self, speed: float | None) -> None:
        """Sets the factor of real time; None is as fast as possible. Raises InputError."""
        if speed is not None and not 0.0 < speed <= MAX_SPEED:
            raise InputError(f"the speed {speed:g} is not a factor above 0, at most {MAX_SPEED:g}")
        self.speed = speed
        self._clock = self.time
        self.changes += 1

    def step_once(self) -> None:
        """Pauses, and simulates one control cycle."""
        self.pause(True)
        self._step()

    def seek(self, time: float) -> None:
        """Goes to the first cycle at or after `time` (s); the calls of `advance` that follow carry it out.

        What a person did after that time is done again unless an interaction comes first.
        """
        if not 0.0 <= time <= 1e7:
            raise InputError(f"cannot go to {time:g} s; give a time from 0 s")
        self.changes += 1
        time = min(time, max(self.end, self.time))
        checkpoint = self._checkpoints.last_before(time)
        if checkpoint is not None and not checkpoint.time <= self.time <= time:
            self._restore(checkpoint)
        elif time < self.time:
            self._start()
        self._seek = time

    def finish_seek(self) -> None:
        """Carries out a seek without a break."""
        while self._seek is not None:
            self._advance_seek(math.inf, lambda: 0.0)

    def restart(self) -> None:
        """Begins again without any interaction."""
        self.interactions.clear()
        self.end = 0.0
        self._seek = None
        self.changes += 1
        self._checkpoints.drop_after(-math.inf)
        self._start()

    # --- interactions -----------------------------------------------------------------------------------------------

    def interact(self, action: dict[str, Any]) -> Any:
        """Carries out an interaction now; `action` has its fields without the time.

        `drive` and `teleop` take `seconds` instead of `until`. Interactions that were to come after a rewind are dropped. Raises
        NavError if it is refused, ValueError if it is none; nothing has changed then.
        """
        if self._seek is not None:
            raise InputError(f"the session is on its way to {self._seek:.1f} s; wait until it is there")
        if len(self.interactions) >= MAX_INTERACTIONS:
            raise InputError(f"the session has {MAX_INTERACTIONS} interactions; save it and start a new one")
        data: dict[str, Any] = {**action, "time": self.time}
        if data.get("kind") in ("drive", "teleop") and "seconds" in data:
            data["until"] = self.time + data.pop("seconds")
        item = INTERACTION.validate_python(data)
        self.run.interact(item)
        del self.interactions[len(self.interactions) - len(self.run.upcoming) :]
        self.run.replace_upcoming()
        self._checkpoints.drop_after(self.time)
        self.end = self.time
        self._add(item)
        self.changes += 1
        return item

    def current_scenario(self) -> Scenario:
        """Returns the scenario with what has been done so far."""
        return replace(self.scenario, interactions=tuple(self.interactions))

    def twin(self) -> Twin:
        """Returns what is needed to simulate the run again up to now, also in another thread."""
        done = self.interactions[: len(self.interactions) - len(self.run.upcoming)]
        return Twin(
            replace(self.scenario, interactions=tuple(done)),
            self.origin,
            self.cycles,
            self.is_done,
            self._digest.digest(),
            self.run.interventions.configuration,
            self.time,
            tuple(self.history.goals.items()),
            self._checkpoints.all(),
        )

    def recorded(self) -> RunRecorder:
        """Simulates the run again up to now, with its record."""
        return self.twin().recorded()

    def save_scenario(self, path: Path) -> Scenario:
        """Writes the session as a scenario file and returns what it loads to. Raises OutputError."""
        return self.twin().save_scenario(path)

    @property
    def robots(self) -> tuple[str, ...]:
        """The names of the robots of a fleet; none for a robot alone."""
        return ()

    def others(self) -> list[tuple[str, Pose2D, str]]:
        """Return the other robots of a fleet: name, pose and what each waits for (empty: nothing)."""
        return []

    def select(self, name: str) -> None:
        """Show another robot of a fleet. Raises InputError: a robot alone is always shown."""
        raise InputError(f'there is no robot "{name}": only one robot drives here', robot=name)

    @property
    def explained(self) -> Replayed:
        """What explanations of the current state look at."""
        return self.run

    @property
    def shapes(self) -> Sequence[Any]:
        """The obstacles in the world."""
        return tuple(self.run.interventions.shapes.values())

    # --- inside -----------------------------------------------------------------------------------------------------

    def _start(self) -> None:
        self.history = History()
        self.run = Run(
            replace(self.scenario, interactions=tuple(self.interactions)),
            record=False,
            measure=False,
            listeners=[self.history],
        )
        self._begin()

    def _begin(self) -> None:
        """Sets what counts cycles and time to the start of a new run."""
        self.cycles = 0
        self.restarts += 1
        self._digest = hashlib.blake2b()
        self._clock = self.time

    def _step(self) -> bool:
        """Simulates until the time advances; False if the run is done. Interactions are allowed only between such steps."""
        before = self.time
        while self.run.step():
            self.cycles += 1
            self._digest.update(digest_of(self.run))
            self.history.add(self.run)
            if self.time > before:
                self.end = max(self.end, self.time)
                self._keep_checkpoint()
                return True
        return False

    def _keep_checkpoint(self) -> None:
        fast = self.speed is None or self.speed > SLOW or self._seek is not None
        spacing = SPACING_FAST if fast else SPACING_SLOW
        if self._checkpoints.is_due(self.cycles, self.time, spacing):
            done = len(self.interactions) - len(self.run.upcoming)
            shared = self.scenario, self.run.scenario, self.scenario.map
            copied = snapshot((self.run, self.history), shared=shared)
            self._checkpoints.keep(self.time, self.cycles, done, self._digest.copy(), copied)

    def _restore(self, checkpoint: Checkpoint) -> None:
        """Returns to the moment of a checkpoint; what was done since then will be done again."""
        self.run, self.history = checkpoint.copied.restore()
        self.run.replace_upcoming(self.interactions[checkpoint.done :])
        self.cycles, self._digest = checkpoint.cycles, checkpoint.digest.copy()
        self.restarts += 1
        self._clock = self.time

    def _advance_seek(self, until: float, timer: Callable[[], float]) -> bool:
        assert self._seek is not None
        while self.time < self._seek - CHECK_TIME:
            if not self._step():
                break
            if timer() >= until:
                return True
        self._seek = None
        self._clock = self.time
        return True

    def _add(self, item: Any) -> None:
        """Keeps an interaction; while the same key is held down, driving by hand is one interaction that gets longer."""
        last = self.interactions[-1] if self.interactions else None
        if (
            isinstance(item, Drive)
            and isinstance(last, Drive)
            and last.velocity == item.velocity
            and item.time < last.until <= item.until
        ):
            self.interactions[-1] = last.model_copy(update={"until": item.until})
            self._checkpoints.drop_after(last.time)  # they know the shorter one
            return
        self.interactions.append(item)

    def _measure(self, simulated_s: float, elapsed_s: float) -> None:
        if elapsed_s > 0.0:
            weight = min(elapsed_s, 1.0)
            self.factor += weight * (simulated_s / elapsed_s - self.factor)
