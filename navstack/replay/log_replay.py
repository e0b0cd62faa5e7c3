"""Replays a log through the stack, open loop: what the costmaps, plans and commands would have been.

The robot does what the log says, not what navstack commands. A cycle runs at the first message at or after the time at which
it is due, when the data that it needs has arrived; without messages it runs at its time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from navstack.bringup import build_move_base
from navstack.core import Event, Listener, LogError, NavError, OccupancyGrid, Pose2D, RecordError, Twist2D, working_time
from navstack.logs import Log, LogMessage, open_log
from navstack.move_base import GoalHandle, MoveBase
from navstack.parameters import Configuration
from navstack.record import Record, RunRecorder
from navstack.replay.comparison import Cycle, Cycles, PlanComparer
from navstack.replay.player import LoggedRobot, Player, find_clock, first_transforms, periods_of, place_robot
from navstack.replay.recording import ReplayRecorder
from navstack.replay.topics import Topics, find_topics
from navstack.ros_messages import Clock
from navstack.ros_messages import messages as ros
from navstack.scenario import Scenario

# --- options of a replay ----------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class ReplayOptions:
    """Options of a replay."""

    start: float | None = None
    """First time (s since the first message); None: the beginning."""
    end: float | None = None
    topics: Mapping[str, str] = field(default_factory=dict[str, str])
    """Topic of the parameters -> topic of the log."""
    goals: tuple[tuple[float, Pose2D], ...] = ()
    """Goals (time, pose in the global frame) in addition to those of the log."""
    initial_pose: Pose2D | None = None
    """Pose of the robot in the map at the start, for logs without a localization."""
    mountings: Mapping[str, tuple[str, tuple[float, ...]]] = field(
        default_factory=dict[str, tuple[str, tuple[float, ...]]]
    )
    """Frame -> parent and x, y, z, yaw, for frames that are not in the log."""
    scans: bool = True
    """Record the scans."""

    def as_dict(self) -> dict[str, Any]:
        """Return the options as JSON data."""
        return {
            "start": self.start,
            "end": self.end,
            "topics": dict(self.topics),
            "goals": [[time, *pose] for time, pose in self.goals],
            "initial_pose": None if self.initial_pose is None else list(self.initial_pose),
            "mountings": {frame: [parent, *values] for frame, (parent, values) in self.mountings.items()},
            "scans": self.scans,
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> ReplayOptions:
        """Restore the options. Raises KeyError, TypeError or ValueError for other data."""
        pose = data["initial_pose"]
        return cls(
            data["start"],
            data["end"],
            {str(name): str(topic) for name, topic in data["topics"].items()},
            tuple((float(goal[0]), Pose2D(*map(float, goal[1:]))) for goal in data["goals"]),
            None if pose is None else Pose2D(*map(float, pose)),
            {str(frame): (str(value[0]), tuple(map(float, value[1:]))) for frame, value in data["mountings"].items()},
            bool(data["scans"]),
        )


MAX_IDLE_CYCLES: Final = 1000
"""Largest number of cycles at one time."""
TOLERANCE_S: Final = 1e-8
"""Times that differ by less are equal."""

RECOVERY_TIME_LIMIT_S: Final = 20.0
"""A recovery behavior that runs longer (s) fails: the robot of a log does not turn for navstack."""

Progress = Callable[[float], None]
"""Called about once per second of the log with its time (s)."""


@dataclass(slots=True)
class ReplayedGoal:
    """A goal of the log, and how it ended in navstack and in the log."""

    pose: Pose2D
    frame: str
    target: Pose2D
    """The pose in the global frame."""
    id: str
    time: float
    """When it was sent (s)."""
    handle: GoalHandle
    ended: float = math.nan
    """When it ended in navstack (s)."""
    attempts: list[str] = field(default_factory=list[str])
    """Reasons for which navstack gave up; the goal was then sent again, because the robot drove on."""
    recorded_end: float = math.nan
    """When it ended in the log (s)."""
    recorded_text: str = ""


class _Failures:
    """Notes that the local planner found no valid command."""

    hears_feedback = False

    def __init__(self) -> None:
        self._failed = False

    def on_event(self, event: Event) -> None:
        """Receive an event of the goal manager."""
        self._failed = self._failed or event.kind == "control_failed"

    def take(self) -> bool:
        """Return True if there was no valid command since the last call."""
        failed, self._failed = self._failed, False
        return failed


class LogReplay:
    """One replay of a log with one configuration. `run` does it; the results are then in the attributes."""

    def __init__(
        self,
        log: Log,
        configuration: Configuration,
        static_map: OccupancyGrid | None,
        options: ReplayOptions | None = None,
        *,
        record: bool = True,
        spool: Path | None = None,
        listeners: Sequence[Listener] = (),
    ) -> None:
        """`static_map`: None for a robot without a map. `spool`: folder in which the record grows, instead of in memory.

        Raises LogError, and the errors of `build_move_base`.
        """
        self.options = options = options or ReplayOptions()
        self.log = log
        # commands have no effect, so the robot may stand although it is commanded to move
        self.configuration = replace(
            configuration, navstack=configuration.navstack.model_copy(update={"stall_timeout": 0.0})
        )
        self.topics: Topics = find_topics(log, configuration, options.topics)
        self.notes = [*log.notes, *self.topics.notes]
        clock, note = find_clock(log, self.topics)
        if note:
            self.notes.append(note)
        self.clock: Clock = clock
        self.robot = LoggedRobot()
        base = configuration.local_costmap.params.robot_base_frame
        self.player = Player(self.robot, self.topics, clock, base_frame=base, periods=periods_of(log, self.topics))
        self.notes += first_transforms(log, self.player, configuration, options.mountings)
        self.notes += place_robot(log, self.player, configuration, options.initial_pose)
        self.cycles = Cycles(folder=spool)
        self.goals: list[ReplayedGoal] = []
        self.compared_plans = PlanComparer()
        self.recorder = (
            ReplayRecorder(
                log, configuration, static_map, self.robot, options.as_dict(), scans=options.scans, spool=spool
            )
            if record
            else None
        )
        self._failures = _Failures()
        own: list[Listener] = [self._failures]
        if self.recorder is not None:
            own.append(self.recorder.recorder)
        self.move_base: MoveBase = build_move_base(
            self.configuration,
            self.robot,
            static_map=static_map,
            listeners=[*own, *listeners],
            recovery_time_limit_s=RECOVERY_TIME_LIMIT_S,
        )
        self.wall_s = 0.0
        self._now = -math.inf
        self._goals = sorted(options.goals, key=lambda goal: goal[0])
        self._begin = -math.inf if options.start is None else options.start
        self._steps = self._run()
        self._patience = 1.0 / max(self.configuration.move_base.controller_frequency, 1.0)

    @property
    def duration(self) -> float:
        """Length of the replayed part (s)."""
        return self.cycles.duration

    @property
    def now(self) -> float:
        """Time of the last cycle (s); before the first one, when the replay begins."""
        return self._now if self._now > -math.inf else self.options.start or 0.0

    @property
    def run_recorder(self) -> RunRecorder | None:
        """The record so far; None without one."""
        return None if self.recorder is None else self.recorder.recorder

    @property
    def pose(self) -> Pose2D:
        """The robot in the global frame; at the origin as long as it is not known."""
        frame, base = self.move_base.global_costmap.frame, self.configuration.local_costmap.params.robot_base_frame
        return self.robot.pose_in(frame, base) or Pose2D(0.0, 0.0)

    def step(self) -> bool:
        """Read the log up to the next cycle and run it. Returns False at the end of the log."""
        if next(self._steps, None) is None:
            self._finish()
            return False
        return True

    def run(self, progress: Progress | None = None, stop: Callable[[], bool] | None = None) -> None:
        """Replay the log. `stop` is called about once per second of the log; True ends the replay with a complete record."""
        begin = working_time()
        shown = -math.inf
        for now in self._steps:
            if now - shown >= 1.0:
                shown = now
                if progress is not None:
                    progress(now)
                if stop is not None and stop():
                    break
        self._finish()
        self.wall_s = working_time() - begin

    def _finish(self) -> None:
        self.compared_plans.settle()
        self._settle_goals(final=True)
        if self.recorder is not None:
            self.recorder.finish(self.goals, self.move_base)

    # --- one moment of the log ----------------------------------------------------------------------------------------

    def _run(self) -> Iterator[float]:
        """Play the log; yields the time (s) of each cycle after it has run."""
        group: list[LogMessage] = []
        for message in self.log.messages(self.topics.used, end=self.options.end):
            if group and message.time_ns != group[0].time_ns:
                yield from self._play(self.clock.time(group[0].time_ns), group)
                group = []
            group.append(message)
        if group:
            yield from self._play(self.clock.time(group[0].time_ns), group)

    def _play(self, now: float, group: Sequence[LogMessage]) -> Iterator[float]:
        """Play the messages of one time: data first, then the cycle, then goals and cancels, and the cycle that they cause."""
        driving = now >= self._begin
        if driving:
            yield from self._run_late_cycles(now)
        events: list[LogMessage] = []
        for message in group:
            if message.topic in self.topics.goals or message.topic in (self.topics.cancels, self.topics.results):
                events.append(message)
            else:
                self.player.play(message)
        if not driving:
            return
        own = self._own_goals(now)
        has_begun = self._now > -math.inf
        if has_begun or not (events or own):
            yield from self._run_cycles(now, at_least_one=bool(events or own) and self._now < now)
        for message in events:
            self._on_event(message, now)
        for pose in own:
            self._send(pose, self.move_base.global_costmap.frame, "", now)
        if events or own:
            yield from self._run_cycles(now)

    def _run_late_cycles(self, until: float) -> Iterator[float]:
        """Run the cycles that are due long before the next message."""
        while self._now > -math.inf:
            due = self.move_base.next_due(self._now)
            if not due + self._patience < until:
                return
            yield self._tick(max(due, self._now))

    def _run_cycles(self, now: float, *, at_least_one: bool = False) -> Iterator[float]:
        """Run the cycles that are due at `now` (s)."""
        for _ in range(MAX_IDLE_CYCLES):
            if not at_least_one and self.move_base.next_due(max(self._now, now)) > now + TOLERANCE_S:
                return
            at_least_one = False
            yield self._tick(now)

    def _tick(self, now: float) -> float:
        move_base, robot = self.move_base, self.robot
        self._resend(now)
        move_base.tick(now)
        self._now = now
        self._settle_goals()
        tick = move_base.last_tick
        if tick.plan is not None and self.topics.plans:
            self.compared_plans.add(now, tick.plan.path.poses)
        self._compare_plans(now)
        active = bool(self.goals) and not self.goals[-1].handle.is_done
        self.cycles.append(
            Cycle(
                now,
                move_base.activity,
                len(self.goals) - 1 if active else -1,
                move_base.command,
                robot.recorded,
                rejected=self._failures.take(),
                controlled=tick.local_plan is not None,
                planned=tick.plan is not None,
            )
        )
        if self.recorder is not None:
            self.recorder.tick(move_base, len(self.goals) - 1)
        return now

    def _compare_plans(self, now: float) -> None:
        """Pass the plans of the log on to the comparison, in the frame of the global costmap."""
        target = self.move_base.global_costmap.frame
        for path in self.player.take_plans():
            poses = path.poses
            if path.frame and path.frame != target:
                try:
                    poses = self.robot.frames.lookup(target, path.frame).apply_poses(poses)
                except NavError:
                    continue
            self.compared_plans.add_recorded(path.time, poses)
        self.compared_plans.settle(now)

    # --- goals --------------------------------------------------------------------------------------------------------

    def _own_goals(self, now: float) -> list[Pose2D]:
        found: list[Pose2D] = []
        while self._goals and self._goals[0][0] <= now + TOLERANCE_S:
            found.append(self._goals.pop(0)[1])
        return found

    def _on_event(self, message: LogMessage, now: float) -> None:
        """Send or cancel a goal, or note how one ended in the log."""
        try:
            if message.topic in self.topics.goals:
                goal = ros.goal_of(message.data, message.type)
                self._send(goal.pose, goal.frame, goal.id, now)
            elif message.topic == self.topics.cancels:
                self._cancel(ros.goal_id_of(message.data))
            else:
                self._on_result(message, now)
        except NavError as exc:
            text = f"{message.topic}: {exc.message}"
            self.player.problems[text] = self.player.problems.get(text, 0) + 1

    def _send(self, pose: Pose2D, frame: str, goal_id: str, now: float) -> None:
        handle = self.move_base.send_goal(pose, frame or None)
        target = self._in_global_frame(pose, frame)
        self.goals.append(ReplayedGoal(pose, frame, target, goal_id, now, handle))
        if self.recorder is not None:
            self.recorder.goal(now, target)

    def _in_global_frame(self, pose: Pose2D, frame: str) -> Pose2D:
        target = self.move_base.global_costmap.frame
        if not frame or frame == target:
            return pose
        try:
            return self.robot.frames.lookup(target, frame).apply(pose)
        except NavError:
            return pose

    def _cancel(self, goal_id: str) -> None:
        for goal in self.goals:
            if not goal.handle.is_done and (not goal_id or goal.id == goal_id):
                self.move_base.cancel_goal(goal.handle)

    def _on_result(self, message: LogMessage, now: float) -> None:
        """Note the end of a goal in the log; navstack's goal ends as well."""
        goal_id, text = ros.result_of(message.data)
        goal = next((g for g in reversed(self.goals) if g.id == goal_id), self.goals[-1] if self.goals else None)
        if goal is None:
            return
        goal.recorded_end, goal.recorded_text = now, text
        if not goal.handle.is_done:
            self.move_base.cancel_goal(goal.handle)

    def _settle_goals(self, *, final: bool = False) -> None:
        for goal in self.goals:
            if math.isnan(goal.ended) and (goal.handle.is_done or final):
                goal.ended = self._now

    def _resend(self, now: float) -> None:
        """Send the last goal again if navstack gave it up but the robot drives on: the comparison goes on."""
        goal = self.goals[-1] if self.goals else None
        if goal is None or not goal.handle.is_done or goal.handle.status.name != "ABORTED":
            return
        if not math.isnan(goal.recorded_end) or now < goal.ended + self._patience:
            return
        recorded = self.robot.recorded
        if recorded is None or recorded == Twist2D():
            return
        goal.attempts.append(goal.handle.result.message or goal.handle.text)
        goal.handle = self.move_base.send_goal(goal.pose, goal.frame or None)
        goal.ended = math.nan


# --- repeats the replay of a log that a record came from --------------------------------------------------------------


def is_of_log(record: Record) -> bool:
    """Return True for the record of a replay of a log."""
    return isinstance(record.scenario.get("log"), dict)


def replay_of_log(record: Record, *, recorded: bool = True, listeners: Sequence[Listener] = ()) -> LogReplay:
    """Return the replay that a record came from, before its first cycle; with `recorded` it is recorded again.

    Raises RecordError if the log is not there.
    """
    stored: Any = record.scenario["log"]
    try:
        path, partial = str(stored["path"]), bool(stored["partial"])
        options = ReplayOptions.from_dict(stored["options"])
    except (KeyError, TypeError, ValueError, AttributeError) as exc:
        raise RecordError(f"{record.path or 'the record'} is damaged: its log is not described ({exc})") from exc
    configuration = Scenario.from_record(record).configuration
    try:
        log = open_log(path, partial=partial)
    except LogError as exc:
        raise RecordError(
            f"{record.path or 'the record'} is the replay of a log, which is needed again: {exc.message}", log=path
        ) from exc
    return LogReplay(log, configuration, record.map, options, record=recorded, listeners=listeners)
