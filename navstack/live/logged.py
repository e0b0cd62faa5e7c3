"""A session of the replay of a log: it plays what the robot saw again, and nothing in it can be changed."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, cast

from navstack.bringup import true_footprint
from navstack.core import InputError, Pose2D, RecordError, RobotState, Twist2D
from navstack.explain import Replayed
from navstack.live.session import History, Session
from navstack.parameters import Configuration
from navstack.record import Record
from navstack.replay import LogReplay, ReplayedGoal, replay_of_log
from navstack.scenario import Run, Scenario


class LoggedSession(Session):
    """A replay with a time line. Going back replays the log from its start: a log has no exact copies of its moments."""

    def __init__(self, record: Record, *, speed: float | None = 1.0) -> None:
        """Raises RecordError if the log is not there."""
        self.record = record
        super().__init__(Scenario.from_record(record), speed=speed)
        self.end = float(record.times[-1])
        self.pause(True)

    def interact(self, action: dict[str, Any]) -> Any:
        """Always raises InputError."""
        raise InputError("this is the replay of a log: only the time can be changed")

    def twin(self) -> Any:
        """Returns what explanations need: the record and the time."""
        return LoggedTwin(self.scenario, self.scenario.configuration, self.record, self.time)

    @property
    def explained(self) -> Replayed:
        """What explanations of the current state look at."""
        return self._logged.replay

    def _start(self) -> None:
        self.history = History()
        self._logged = LoggedRun(self.record, self.history)
        # it has what a page shows of a run
        self.run = cast(Run, self._logged)
        self._begin()
        self._step()  # only then it is known where the robot is

    def _keep_checkpoint(self) -> None:
        """Keeps none: the place in a log cannot be copied."""


@dataclass(frozen=True, slots=True)
class LoggedTwin:
    """What explanations of a replay need."""

    scenario: Scenario
    configuration: Configuration
    _record: Record
    until: float
    """The current time (s)."""

    def record_for_command(self, time: float) -> Record:
        """Returns the record of the whole replay."""
        del time
        return self._record

    def record_for_goal(self, number: int) -> tuple[Record, str | None]:
        """Returns the record of the whole replay."""
        del number
        return self._record, None


class LoggedRun:
    """A replay in the form of a `Run`, as far as pages show it. Raises RecordError where it differs from the record."""

    upcoming = ()

    def __init__(self, record: Record, history: History) -> None:
        self._record = record
        self.replay: LogReplay = replay_of_log(record, recorded=False, listeners=[history])
        self.move_base = self.replay.move_base
        self.robot = _Robot(self.replay)
        self.goals = _Goals(self.replay)
        configuration = self.replay.configuration
        self.interventions = SimpleNamespace(configuration=configuration, teleop=None, shapes={})
        self.done = False
        self.path_length = 0.0
        self._cycles = 0

    def step(self) -> bool:
        """Runs the next cycle; returns False at the end of the log."""
        if self._cycles >= len(self._record.samples):
            self.done = True
            return False
        before = self.robot.pose
        if not self.replay.step():
            raise self._differs("the log has ended")
        row = self._record.samples[self._cycles]
        command = Twist2D(float(row["cmd_vx"]), float(row["cmd_vy"]), float(row["cmd_wz"]))
        if self.move_base.now != row["t"] or self.move_base.command != command:
            raise self._differs("its commands differ")
        self._cycles += 1
        if self._cycles > 1:
            self.path_length += self.robot.pose.distance_to(before)
        return True

    def _differs(self, what: str) -> RecordError:
        return RecordError(
            f"the replay of the log is not that of {self._record.path or 'the record'} ({what}); replay the log again with "
            "`navstack replay`"
        )


class _Robot:
    """The robot of a log, as a simulated robot is shown."""

    by_hand = None
    steering_angle = 0.0
    clearance = math.nan
    collisions = ()
    world = SimpleNamespace(moves=False)
    moves = False
    solids = None

    def __init__(self, replay: LogReplay) -> None:
        configuration = replay.configuration
        self._replay = replay
        self.frames = replay.robot.frames
        self.params = configuration.navstack.sim
        self.footprint = true_footprint(configuration)
        self.map_frame = replay.move_base.global_costmap.frame
        self.base_frame = configuration.local_costmap.params.robot_base_frame

    @property
    def time(self) -> float:
        return self._replay.now

    @property
    def pose(self) -> Pose2D:
        return self._replay.pose

    def state(self) -> RobotState:
        return self._replay.robot.odometry or RobotState(self.pose, Twist2D(), self.time)


class _Goals:
    """The goals of a log, as those of a run are shown."""

    loop = False
    waiting = ()

    def __init__(self, replay: LogReplay) -> None:
        self._replay = replay

    @property
    def under_way(self) -> list[Any]:
        return [
            SimpleNamespace(index=number, target=goal.target, handle=goal.handle)
            for number, goal in self._of(ended=False)
        ]

    @property
    def outcomes(self) -> list[Any]:
        return [
            SimpleNamespace(
                goal=goal.target,
                state=goal.handle.status.name,
                time_s=goal.ended - goal.time,
                message=goal.handle.result.message or goal.handle.text,
            )
            for _, goal in self._of(ended=True)
        ]

    def _of(self, *, ended: bool) -> Iterator[tuple[int, ReplayedGoal]]:
        goals = enumerate(self._replay.goals)
        return ((number, goal) for number, goal in goals if goal.handle.is_done == ended)
