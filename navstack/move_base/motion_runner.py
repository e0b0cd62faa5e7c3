"""Runs one motion step by step while no goal is active."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

from navstack.core import Path, Pose2D, Transform2D, Twist2D
from navstack.core.errors import InputError, NavError
from navstack.interfaces import Motion, Plan, RecoveryContext, RecoveryStatus
from navstack.move_base import plugin_calls
from navstack.move_base.action_server import SimpleActionServer
from navstack.move_base.command_output import ZERO, CommandOutput
from navstack.move_base.costmap_updater import CostmapUpdater
from navstack.move_base.errors import BusyError, GoalCanceledError, StaleSensorsError
from navstack.move_base.goal import GoalResult
from navstack.move_base.goal_status import GoalStatus
from navstack.move_base.navigation import Navigation
from navstack.move_base.schedule import EPSILON_S, Schedule

ACTIVITY: Final = "MOTION"
"""State of the robot while a motion runs, in records."""
SOURCE: Final = "motion"
"""Input of the command multiplexer."""


@dataclass(slots=True, eq=False)
class MotionHandle:
    """A motion as its client sees it."""

    id: str
    motion: Motion
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

    @property
    def is_done(self) -> bool:
        """True in a terminal state."""
        return self.status.is_terminal

    @property
    def result(self) -> GoalResult:
        """The outcome in the form of a goal's."""
        error = self.error
        return GoalResult(
            self.status,
            self.text,
            0 if error is None else error.code,
            "NONE" if error is None else error.name,
            "" if error is None else error.message,
            self.data,
            sent_at=self.sent_at,
            accepted_at=self.sent_at,
            ended_at=self.sent_at if self.ended_at is None else self.ended_at,
        )

    @property
    def succeeded(self) -> bool:
        """True if the motion did what it should."""
        return self.status is GoalStatus.SUCCEEDED


class MotionRunner:
    """The running motion, if any, and its schedule. Its commands go where those of the local planner go."""

    def __init__(
        self,
        navigation: Navigation,
        server: SimpleActionServer,
        command: CommandOutput,
        costmaps: CostmapUpdater,
        context: Callable[[], RecoveryContext],
    ) -> None:
        """`context` returns what a motion may act on; it changes with the local planner."""
        self.running: MotionHandle | None = None
        self._navigation = navigation
        self._server = server
        self._context = context
        self._command = command
        self._costmaps = costmaps
        self._steps = Schedule(0.0)
        self._stale_since: float | None = None
        self._count = 0

    @property
    def due(self) -> float:
        """Time of the next step (s); inf without a motion."""
        return self._steps.due if self.running is not None else math.inf

    def start(self, motion: Motion) -> MotionHandle:
        """Start a motion, whose first step is due at once; one that is running is cancelled.

        A goal that is sent later cancels the motion. Errors of the motion end in its handle. Raises BusyError while a goal is
        active.
        """
        self._require_idle(motion.name)
        now = self._navigation.last_tick.time
        self.cancel()
        self._count += 1
        handle = self.running = MotionHandle(f"{motion.name}-{self._count}", motion, now)
        self._stale_since = None
        self._command.error = None
        self._costmaps.enable(True, now)
        self._costmaps.retry_failed(now)
        self._publish_start(handle, now)
        context = self._context()
        try:
            plugin_calls.call(motion, motion.check, context)
            frequency = plugin_calls.start_recovery(motion, context, now)
        except NavError as exc:
            self._end(handle, now, exc)
            return handle
        self._steps = Schedule(frequency or context.controller_frequency, now)
        return handle

    def cancel(self) -> None:
        """Stop the running motion and the robot."""
        handle, now = self.running, self._navigation.last_tick.time
        if handle is not None:
            age = now - handle.sent_at
            self._end(handle, now, GoalCanceledError(f"{handle.motion.name} was cancelled after {age:.1f} s"))

    def drive(self, twist: Twist2D) -> None:
        """Drive at a velocity that comes from outside (teleop) until the next command; a running motion is cancelled.

        With a command multiplexer, teleop overrides an active goal for its time-out. Without one this raises BusyError while a
        goal is active. Raises InputError for a velocity that is not finite, and the robot's error.
        """
        if not twist.is_finite():
            raise InputError(f"the command {tuple(twist)} is not finite", command=twist)
        if not self._command.has_sources:
            self._require_idle("a command from outside")
        self.cancel()
        self._command.error = None
        self._command.send(twist, self._navigation.last_tick.time, "teleop")
        if self._command.error is not None:
            raise self._command.error

    def run(self, now: float) -> None:
        """Execute the step that is due at `now` (s)."""
        handle = self.running
        if handle is None or not self._steps.is_due(now):
            return
        self._steps.advance(now)
        motion = handle.motion
        try:
            if self._is_stale(now):
                return
            step = plugin_calls.recovery_step(motion, self._costmaps.local_state(now), now)
        except NavError as exc:
            self._end(handle, now, exc)
            return
        if not handle.has_begun:
            self._publish_target(handle, now)
        handle.data = {key: value for key, value in step.data.items() if key != "notes"}
        if step.status is RecoveryStatus.RUNNING:
            self._navigation.last_tick.local_plan = motion.local_plan
            self._command.send(step.twist, now, SOURCE)
            if self._command.error is not None:
                self._end(handle, now, self._command.error)
            return
        handle.text = step.text
        failed = step.status is RecoveryStatus.FAILED
        self._end(handle, now, NavError(step.text or f"{motion.name} failed", **handle.data) if failed else None)

    def _require_idle(self, what: str) -> None:
        if not self._navigation.is_idle or self._server.is_new_goal_available:
            raise BusyError(f"{what} must wait: a goal is active; cancel it first")

    # --- parts of a step ----------------------------------------------------------------------------------------------

    def _is_stale(self, now: float) -> bool:
        """Return True if the robot must not move at `now` (s): it stands then. Raises StaleSensorsError after the patience."""
        navigation = self._navigation
        costmap = navigation.local_costmap
        cause = self._costmaps.local_error
        if cause is None and plugin_calls.is_current(costmap, now):
            self._stale_since = None
            return False
        if self._stale_since is None:
            self._stale_since = now
            navigation.events.warn(now, f"{costmap.name} is not current: the motion waits", cause)
        if now - self._stale_since >= navigation.params.controller_patience - EPSILON_S:
            raise StaleSensorsError(
                f"{costmap.name} has not been current for controller_patience ({navigation.params.controller_patience:g} s)"
                + (f": {cause.message}" if cause is not None else "; check its sensors and their topics"),
                costmap=costmap.name,
                since=self._stale_since,
            )
        self._stop(now)
        return True

    def _stop(self, now: float) -> None:
        if self._command.last != ZERO:
            self._command.send(ZERO, now, SOURCE)

    def _end(self, handle: MotionHandle, now: float, error: NavError | None) -> None:
        canceled = isinstance(error, GoalCanceledError)
        handle.error = error
        handle.status = (
            GoalStatus.SUCCEEDED if error is None else GoalStatus.PREEMPTED if canceled else GoalStatus.ABORTED
        )
        handle.text = error.message if error is not None else handle.text
        handle.ended_at = now
        self.running = None
        self._stop(now)
        if self._navigation.is_idle:
            self._costmaps.enable(not self._navigation.params.shutdown_costmaps, now)
        self._publish_end(handle, now)

    # --- events -------------------------------------------------------------------------------------------------------

    def _publish_start(self, handle: MotionHandle, now: float) -> None:
        events, name = self._navigation.events, handle.motion.name
        status = {"id": handle.id, "status": "ACTIVE", "number": int(GoalStatus.ACTIVE), "text": ""}
        events.publish(now, "status", f"ACTIVE: {handle.id}", status)
        events.publish(now, "state", f"IDLE -> {ACTIVITY}: {name}", {"from": "IDLE", "to": ACTIVITY, "event": name})

    def _publish_target(self, handle: MotionHandle, now: float) -> None:
        """Publish what the motion will do, once its first step has determined it."""
        handle.has_begun = True
        navigation, motion = self._navigation, handle.motion
        frame = navigation.global_costmap.frame
        if motion.target is not None:
            x, y, yaw = handle.target = self._to_global(motion.frame, now).apply(motion.target)
            data = {"id": handle.id, "pose": [x, y, yaw], "frame": frame, "stamp": handle.sent_at}
            navigation.events.publish(
                now, "goal", f'{handle.id}: ends at ({x:.3f}, {y:.3f}, {yaw:.3f}) in "{frame}"', data
            )
        what = motion.describe()
        data = {**what, "id": handle.id, "name": motion.name, "frame": motion.frame, "at": now}
        navigation.events.publish(now, "motion", f"{motion.name} begins", data)
        if motion.reference is not None and motion.target is not None and motion.reference.length > 0.0:
            path = Path(motion.reference.poses, motion.frame)
            plan = navigation.last_tick.plan = Plan(path, 0.0, motion.target)
            navigation.events.plan(now, plan)

    def _publish_end(self, handle: MotionHandle, now: float) -> None:
        events, error = self._navigation.events, handle.error
        data: dict[str, Any] = {
            "id": handle.id,
            "status": handle.status.name,
            "number": int(handle.status),
            "error_code": 0 if error is None else error.code,
            "error_name": "NONE" if error is None else error.name,
            "message": "" if error is None else error.message,
            "text": handle.text if error is None else "",
        }
        name = handle.motion.name
        if handle.has_begun:
            events.publish(now, "motion", f"{name} ended", {**handle.data, "id": handle.id, "name": name})
        events.publish(now, "status", f"{handle.status.name}: {handle.text}", data)
        events.publish(
            now, "state", f"{ACTIVITY} -> IDLE: {name} ended", {"from": ACTIVITY, "to": "IDLE", "event": name}
        )

    def _to_global(self, frame: str, now: float) -> Transform2D:
        navigation = self._navigation
        target = navigation.global_costmap.frame
        if frame in ("", target):
            return Transform2D()
        tolerance = plugin_calls.transform_tolerance(navigation.global_costmap)
        try:
            return plugin_calls.lookup_transform(navigation.robot, target, frame, now, tolerance)
        except NavError:
            return Transform2D()
