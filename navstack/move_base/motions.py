"""Runs one motion step by step while no goal is active."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

from navstack.behaviors import AssistedTeleop, BehaviorRunner
from navstack.core import InputError, NavError, Path, Pose2D, Transform2D, Twist2D
from navstack.move_base.checks import stale_sensors
from navstack.move_base.control import ControlInputs
from navstack.move_base.costmaps import CostmapUpdater, transform_tolerance
from navstack.move_base.errors import BusyError, GoalCanceledError, StaleSensorsError
from navstack.move_base.events import EventPublisher
from navstack.move_base.goals import GoalResult, GoalStatus
from navstack.move_base.output import CommandOutput
from navstack.move_base.plugin_calls import (
    call,
    checked_braking,
    checked_flag,
    checked_path,
    checked_pose,
    lookup_transform,
)
from navstack.move_base.schedule import EPSILON_S, Schedule
from navstack.parameters import MoveBaseParams
from navstack.plugins import Behavior, BehaviorContext, BehaviorStep, Plan, Robot

ACTIVITY: Final = "MOTION"
"""State of the robot while a motion runs, in records."""
SOURCE: Final = "motion"
"""Input of the command multiplexer."""


@dataclass(slots=True, eq=False)
class MotionHandle:
    """A motion as its client sees it."""

    id: str
    motion: Behavior
    sent_at: float
    """Seconds."""
    status: GoalStatus = GoalStatus.ACTIVE
    text: str = ""
    """What the motion did, or why it failed."""
    error: NavError | None = None
    data: dict[str, Any] = field(default_factory=dict[str, Any])
    """The motion's own figures at its last step."""
    target: Pose2D | None = None
    """Where the motion ends, in the global costmap's frame; None before its first step."""
    ended_at: float | None = None
    has_begun: bool = False
    """True after its first step."""
    line: Path | None = None
    """The path that was published last; a motion may change it."""

    @property
    def is_done(self) -> bool:
        """True in a terminal state."""
        return self.status.is_terminal

    @property
    def result(self) -> GoalResult:
        """The outcome in the form of a goal's."""
        ended_at = self.sent_at if self.ended_at is None else self.ended_at
        return GoalResult.of(
            self.status,
            self.text,
            self.error,
            self.data,
            sent_at=self.sent_at,
            accepted_at=self.sent_at,
            ended_at=ended_at,
        )

    @property
    def succeeded(self) -> bool:
        """True if the motion did what it should."""
        return self.status is GoalStatus.SUCCEEDED


class MotionRunner:
    """The running motion, if any. Its commands go where those of the local planner go."""

    def __init__(
        self,
        robot: Robot,
        params: MoveBaseParams,
        context: BehaviorContext,
        *,
        costmaps: CostmapUpdater,
        inputs: ControlInputs,
        output: CommandOutput,
        events: EventPublisher,
        is_idle: Callable[[], bool],
        running_recovery: Callable[[], Behavior | None],
    ) -> None:
        """`is_idle` returns True while no goal is active or waits."""
        self.running: MotionHandle | None = None
        self.params = params
        self.context = context
        """What a motion may act on; it changes with the local planner."""
        self._robot = robot
        self._costmaps = costmaps
        self._inputs = inputs
        self._output = output
        self._events = events
        self._is_idle = is_idle
        self._running_recovery = running_recovery
        self._runner = BehaviorRunner(Schedule, call)
        self._stale_since: float | None = None
        self._count = 0

    @property
    def due(self) -> float:
        """Time of the next step (s); inf without a motion."""
        return self._runner.due

    def start(self, motion: Behavior) -> MotionHandle:
        """Start a motion, whose first step is due at once; one that is running is canceled.

        A goal that is sent later cancels the motion. Errors of the motion end in its handle. Raises BusyError while a goal is
        active.
        """
        self._require_idle(motion.name)
        now = self._output.tick.time
        self.cancel()
        self._count += 1
        handle = self.running = MotionHandle(f"{motion.name}-{self._count}", motion, now)
        self._stale_since = None
        self._output.error = None
        self._costmaps.enable(True, now)
        self._costmaps.retry_failed(now)
        self._inputs.start_goal()
        self._publish_start(handle, now)
        end = self._runner.start(motion, self.context, now, self.context.controller_frequency, check=True)
        if end is not None:
            self._end(handle, now, end.error)
        return handle

    def cancel(self, error: NavError | None = None) -> None:
        """Stop the running motion and the robot; `error`: why, if no client canceled it."""
        handle, now = self.running, self._output.tick.time
        if handle is not None:
            age = now - handle.sent_at
            self._end(handle, now, error or GoalCanceledError(f"{handle.motion.name} was canceled after {age:.1f} s"))

    @property
    def assisted(self) -> AssistedTeleop | None:
        """The `assisted_teleop` that runs, as a motion or for a goal; None without one."""
        for behavior in (self._running_recovery(), None if self.running is None else self.running.motion):
            if isinstance(behavior, AssistedTeleop):
                return behavior
        return None

    def drive(self, twist: Twist2D) -> None:
        """Drive at a velocity that comes from outside (teleop) until the next command; a running motion is canceled.

        With a command multiplexer, teleop overrides an active goal for its time-out. Without one this raises BusyError while a
        goal is active. While `assisted_teleop` runs, it takes the command. Raises InputError for a velocity that is not finite,
        and the robot's error.
        """
        output = self._output
        if not twist.is_finite():
            raise InputError(f"the command {tuple(twist)} is not finite", command=twist)
        assisted = self.assisted
        if assisted is not None:
            assisted.take(twist, output.tick.time)
            return
        if output.chain is None:
            self._require_idle("a command from outside")
        self.cancel()
        output.error = None
        output.send(twist, output.tick.time, "teleop")
        if output.error is not None:
            raise output.error

    def run(self, now: float) -> None:
        """Execute the step that is due at `now` (s)."""
        handle = self.running
        if handle is None or not self._runner.is_due(now):
            return
        self._runner.advance(now)
        try:
            if self._is_stale(now):
                return
        except NavError as exc:
            self._end(handle, now, exc)
            return
        found = self._runner.step(self._inputs.state, now)
        step = found if isinstance(found, BehaviorStep) else found.step
        if step is not None:
            if not handle.has_begun:
                try:
                    self._publish_begin(handle, now)
                except NavError as exc:
                    self._end(handle, now, exc)
                    return
            handle.data = {key: value for key, value in step.data.items() if key != "notes"}
        if not isinstance(found, BehaviorStep):
            handle.text = found.text
            self._end(handle, now, found.error)
            return
        motion = handle.motion
        if motion.reference is not handle.line:
            self._publish_line(handle, now)
        try:
            self._output.tick.local_plan = call(motion, getattr, motion, "local_plan", check=checked_braking)
        except NavError as exc:
            self._end(handle, now, exc)
            return
        self._output.send(found.twist, now, SOURCE)
        if self._output.error is not None:
            self._end(handle, now, self._output.error)

    def _require_idle(self, what: str) -> None:
        if not self._is_idle():
            raise BusyError(f"{what} must wait: a goal is active; cancel it first")

    # --- parts of a step ----------------------------------------------------------------------------------------------

    def _is_stale(self, now: float) -> bool:
        """Return True if the robot must not move at `now` (s): it stands then. Raises StaleSensorsError after the patience."""
        costmap, patience = self.context.local_costmap, self.params.controller_patience
        cause = self._costmaps.local_error
        if cause is None and call(costmap, costmap.is_current, now, check=checked_flag):
            self._stale_since = None
            return False
        if self._stale_since is None:
            self._stale_since = now
            self._events.warn(now, f"{costmap.name} is not current: the motion waits", cause)
        if now - self._stale_since >= patience - EPSILON_S:
            what = f"has been stale for controller_patience ({patience:g} s)"
            if cause is not None:
                text = f"{costmap.name} {what}: {cause.message}"
                raise StaleSensorsError(text, costmap=costmap.name, since=self._stale_since)
            raise stale_sensors(costmap, what, self._stale_since)
        self._output.stop_if_moving(now, SOURCE)
        return True

    def _end(self, handle: MotionHandle, now: float, error: NavError | None) -> None:
        canceled = isinstance(error, GoalCanceledError)
        handle.error = error
        handle.status = (
            GoalStatus.SUCCEEDED if error is None else GoalStatus.PREEMPTED if canceled else GoalStatus.ABORTED
        )
        handle.text = error.message if error is not None else handle.text
        handle.ended_at = now
        self.running = None
        self._runner.drop(now)
        self._output.stop_if_moving(now, SOURCE)
        self._costmaps.enable(not self.params.shutdown_costmaps, now)
        if not handle.has_begun and error is not None and handle.motion.target is not None:
            with contextlib.suppress(NavError):  # pictures show where it was to go; without a transform, they do not
                self._publish_target(handle, now)
                self._publish_line(handle, now)
        self._publish_end(handle, now)

    # --- events -------------------------------------------------------------------------------------------------------

    def _publish_start(self, handle: MotionHandle, now: float) -> None:
        events, name = self._events, handle.motion.name
        status = {"id": handle.id, "status": "ACTIVE", "number": int(GoalStatus.ACTIVE), "text": ""}
        events.publish(now, "status", f"ACTIVE: {handle.id}", status)
        events.publish(now, "state", f"IDLE -> {ACTIVITY}: {name}", {"from": "IDLE", "to": ACTIVITY, "event": name})

    def _publish_begin(self, handle: MotionHandle, now: float) -> None:
        """Publish what the motion will do, once its first step has determined it."""
        handle.has_begun = True
        self._publish_target(handle, now)
        motion = handle.motion
        what = call(motion, motion.describe, check=dict)
        data = {**what, "id": handle.id, "name": motion.name, "frame": motion.frame, "at": now}
        self._events.publish(now, "motion", f"{motion.name} begins", data)
        self._publish_line(handle, now)

    def _publish_target(self, handle: MotionHandle, now: float) -> None:
        motion, frame = handle.motion, self.context.global_costmap.frame
        target = motion.target
        if target is not None:
            target = call(motion, lambda: target, check=checked_pose)
            x, y, yaw = handle.target = self._to_global(motion.frame, now).apply(target)
            data = {"id": handle.id, "pose": [x, y, yaw], "frame": frame, "stamp": handle.sent_at}
            text = f'{handle.id}: ends at ({x:.3f}, {y:.3f}, {yaw:.3f}) in "{frame}"'
            self._events.publish(now, "goal", text, data)

    def _publish_line(self, handle: MotionHandle, now: float) -> None:
        motion = handle.motion
        target, path = motion.target, motion.reference
        handle.line = path
        if path is not None:
            path = call(motion, lambda: path, check=checked_path)
        if path is not None and target is not None and path.length > 0.0:
            plan = self._output.tick.plan = Plan(Path(path.poses, motion.frame), 0.0, target)
            self._events.plan(now, plan)

    def _publish_end(self, handle: MotionHandle, now: float) -> None:
        events, error = self._events, handle.error
        data: dict[str, Any] = {
            "id": handle.id,
            "status": handle.status.name,
            "number": int(handle.status),
            "error_code": 0 if error is None else error.code,
            "error_name": "NONE" if error is None else error.name,
            "message": "" if error is None else error.message,
            "text": handle.text if error is None else "",
        }
        if error is not None and "collision_ahead" in error.data:
            data["collision_ahead"] = error.data["collision_ahead"]
        name = handle.motion.name
        if handle.has_begun:
            events.publish(now, "motion", f"{name} ended", {**handle.data, "id": handle.id, "name": name})
        events.publish(now, "status", f"{handle.status.name}: {handle.text}", data)
        events.publish(
            now, "state", f"{ACTIVITY} -> IDLE: {name} ended", {"from": ACTIVITY, "to": "IDLE", "event": name}
        )

    def _to_global(self, frame: str, now: float) -> Transform2D:
        costmap = self.context.global_costmap
        if frame in ("", costmap.frame):
            return Transform2D()
        try:
            return lookup_transform(self._robot, costmap.frame, frame, now, transform_tolerance(costmap))
        except NavError:
            return Transform2D()
