"""Docking and undocking as one task of a goal manager: staging by a goal, the rest by a motion. The caller ticks."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

from navstack.core import BatteryState, DockDetection, Event, NavError, Pose2D, SensorData, angle_between
from navstack.docking.behavior import Approach, DockingLog, DockingState, DockSensing, Leave
from navstack.docking.database import Dock, DockDatabase
from navstack.docking.errors import FailedToChargeError, FailedToStageError
from navstack.move_base import BusyError, GoalCanceledError, GoalHandle, GoalResult, GoalStatus, MotionHandle, MoveBase
from navstack.parameters import DockingParams
from navstack.plugins import DockingRobot, DockType

MAX_STAGING_TIME_S: Final = 1000.0
"""Nav2's max_staging_time."""
PRESTAGING_RAD: Final = 0.5
"""Angle to the heading of the staging pose from which on the robot drives there first."""
MAX_UNDOCKING_TIME_S: Final = 30.0
"""Nav2's max_undocking_time."""


def docking_robot(robot: object) -> DockingRobot | None:
    """Return the robot behind a command chain, if it has detections of docks and a battery."""
    robot = getattr(robot, "robot", robot)
    return robot if isinstance(robot, DockingRobot) else None


def is_staged(here: Pose2D, staging: Pose2D, params: DockingParams) -> bool:
    """Return True if a robot is within dock_prestaging_tolerance of the staging pose and looks as it should."""
    near = here.distance_to(staging) <= params.dock_prestaging_tolerance
    return near and abs(angle_between(here.yaw, staging.yaw)) <= PRESTAGING_RAD


def undocked_dock(move_base: MoveBase, database: DockDatabase, dock_type: str) -> Dock:
    """Return a dock at the robot's pose, of this type, or of that of the nearest dock; with its name."""
    here = move_base.global_costmap.robot_pose(move_base.last_tick.time)
    nearest = min(database.docks.values(), key=lambda one: here.distance_to(one.pose), default=None)
    name = dock_type or (nearest.type if nearest is not None else "")
    return Dock(nearest.name if nearest is not None else "dock", name, here, move_base.global_costmap.frame)


@dataclass(frozen=True, slots=True)
class DockingFeedback:
    """Progress of docking, as the feedback of Nav2's DockRobot."""

    state: DockingState
    docking_time: float
    """s since the start."""
    num_retries: int


class DockTask:
    """One docking or undocking. After `start`, call `advance` after every tick of the goal manager until `is_done`."""

    def __init__(self, move_base: MoveBase, database: DockDatabase, dock: Dock, dock_type: DockType, kind: str) -> None:
        """`kind`: `dock` or `undock`."""
        self.dock, self.kind = dock, kind
        self.log = DockingLog(dock.name)
        self.status = GoalStatus.PENDING
        self.text = ""
        self.error: NavError | None = None
        self.target: Pose2D | None = dock.pose if kind == "dock" else None
        self.started_at = self.ended_at = 0.0
        self.dock_type = dock_type
        self.params = database.params
        self.sensing = DockSensing(move_base.robot.frames)
        self._move_base = move_base
        self._robot = docking_robot(move_base.robot)
        self._goal: GoalHandle | None = None
        self._motion: MotionHandle | None = None
        self._published = 0
        self.errand = False
        """True if it is no goal of its own, but part of one: `low_battery`."""
        self._parts: list[str] = []
        """Ids of the goals and motions that it consists of."""

    # --- what a client sees -------------------------------------------------------------------------------------------

    @property
    def is_done(self) -> bool:
        """True in a terminal state."""
        return self.status.is_terminal

    @property
    def succeeded(self) -> bool:
        """True if the robot is docked, or undocked."""
        return self.status is GoalStatus.SUCCEEDED

    @property
    def is_staging(self) -> bool:
        """True while a goal drives the robot to the staging pose."""
        return self._goal is not None and not self._goal.is_done

    @property
    def state(self) -> DockingState:
        """What the robot does now, as in Nav2's feedback."""
        return self.log.state if not self.is_done else DockingState.NONE

    @property
    def docking_time(self) -> float:
        """Time since the start (s)."""
        return (self.ended_at if self.is_done else self._now) - self.started_at

    @property
    def feedback(self) -> DockingFeedback:
        """The progress."""
        return DockingFeedback(self.state, self.docking_time, self.log.retries)

    @property
    def data(self) -> dict[str, Any]:
        """The states, as JSON data."""
        return {"docking": self.log.as_dict()}

    @property
    def result(self) -> GoalResult:
        """The outcome in the form of a goal's."""
        begin, end = self.started_at, self.ended_at
        return GoalResult.of(
            self.status, self.text, self.error, self.data, sent_at=begin, accepted_at=begin, ended_at=end
        )

    # --- course -------------------------------------------------------------------------------------------------------

    @property
    def _now(self) -> float:
        return self._move_base.last_tick.time

    def start(self) -> None:
        """Start at the time of the last tick. Errors end in the result."""
        self.started_at, self.status = self._now, GoalStatus.ACTIVE

    def advance(self) -> None:
        """Take what the last tick brought, and go on to the next part."""
        if self.is_done:
            return
        data: list[SensorData | DockDetection] = list(self._move_base.last_tick.scans)
        battery: BatteryState | None = None
        if self._robot is not None:
            data += self._robot.dock_detections()
            battery = self._robot.battery_state
        self.sensing.add(data, battery)
        if self._goal is not None and self._motion is None:
            self._follow_goal(self._goal)
        motion = self._motion
        if motion is not None and motion.is_done:
            self.arrived(motion)
        self._publish()

    def cancel(self, error: NavError | None = None) -> None:
        """Stop the robot and end; `error`: why, if no client canceled it."""
        if self.is_done:
            return
        if self._goal is not None and not self._goal.is_done:
            self._move_base.cancel_goal(self._goal)
        if self._motion is not None and self._move_base.motions.running is self._motion:
            self._move_base.motions.cancel()
        what = "docking" if self.kind == "dock" else "undocking"
        error = error or GoalCanceledError(
            f"{what} was canceled after {self.docking_time:.1f} s ({self.log.state.name})"
        )
        status = GoalStatus.PREEMPTED if isinstance(error, GoalCanceledError) else GoalStatus.ABORTED
        self.end(status, error.message, error)
        self._publish()

    def stage(self, pose: Pose2D, time_limit_s: float) -> None:
        """Send the staging pose, in the frame of the dock, as a goal."""
        self.log.enter(DockingState.NAV_TO_STAGING_POSE, self._now, self._distance())
        self._goal = self._move_base.send_goal(pose, self.dock.frame, time_limit_s=time_limit_s)
        self._parts.append(self._goal.id)

    def run(self, motion: Approach | Leave) -> None:
        """Start the motion, or at the next tick if the goal manager is still busy."""
        try:
            self._motion = self._move_base.motions.start(motion)
        except BusyError:
            return
        self._parts.append(self._motion.id)

    def arrived(self, motion: MotionHandle) -> None:
        """End as the motion ended."""
        self.end(motion.status, motion.text, motion.error)

    def end(self, status: GoalStatus, text: str, error: NavError | None) -> None:
        """Enter the terminal state."""
        self.status, self.text, self.error = status, text, error
        self.ended_at = self._now
        if error is not None:
            self.log.fail(error)

    def _follow_goal(self, goal: GoalHandle) -> None:
        """Update the log on the way to the staging pose; go on, or end with FailedToStageError."""
        if self.log.state is DockingState.NAV_TO_STAGING_POSE:
            self.log.update(self._now, self._distance(), "")
        if not goal.is_done:
            return
        if goal.status is GoalStatus.SUCCEEDED:
            self.staged()
            return
        if goal.status in (GoalStatus.PREEMPTED, GoalStatus.RECALLED):
            self.end(
                GoalStatus.PREEMPTED,
                goal.text,
                GoalCanceledError(goal.text or "another goal replaced the staging pose"),
            )
            return
        result = goal.result
        reason = result.message or goal.text
        error = FailedToStageError(
            f"{self.dock.name}: the robot did not reach the staging pose: {reason}",
            cause=result.error_code,
            cause_name=result.error_name,
            distance_m=self._distance(),
        )
        self.end(GoalStatus.ABORTED, error.message, error)

    def staged(self) -> None:
        """Go on from the staging pose."""

    def _distance(self) -> float:
        """Return the distance from the robot to the dock in the global frame (m); NaN without a pose."""
        try:
            return self._move_base.global_costmap.robot_pose(self._now).distance_to(self.dock.pose)
        except NavError:
            return math.nan

    # --- events -------------------------------------------------------------------------------------------------------

    def _publish(self) -> None:
        """Publish the states that have been entered since the last call, and the end."""
        for visit in self.log.visits[self._published :]:
            text = f"{self.dock.name}: {visit.state}, attempt {visit.attempt}"
            self._send(visit.begin, text, {"dock": self.dock.name, "kind": self.kind, **visit.as_dict()})
        self._published = len(self.log.visits)
        if self.is_done:
            result = self.result
            data = {
                "kind": self.kind,
                "parts": list(self._parts),
                "errand": self.errand,
                "status": result.status.name,
                "error_code": result.error_code,
                "error_name": result.error_name,
                "message": result.message,
                **self.log.as_dict(),
            }
            self._send(self.ended_at, f"{self.dock.name}: {result.message or self.text}", data)

    def _send(self, time: float, text: str, data: dict[str, Any]) -> None:
        for listener in self._move_base.listeners:
            listener.on_event(Event(max(time, self.started_at), "docking", text, data))


class Docking(DockTask):
    """Drives to the staging pose of a dock, into the dock, and waits until it is charged."""

    def __init__(
        self,
        move_base: MoveBase,
        database: DockDatabase,
        dock: Dock | str,
        *,
        navigate_to_staging_pose: bool = True,
        max_staging_time_s: float = MAX_STAGING_TIME_S,
        charge_until: float | None = None,
    ) -> None:
        """`dock`: its name, or a dock that is in no database; with `charge_until` it ends when the battery has that charge.

        Raises DockNotInDatabaseError and DockNotValidError.
        """
        dock = database.dock(dock) if isinstance(dock, str) else dock
        super().__init__(move_base, database, dock, database.type_of(dock), "dock")
        self._navigates, self._limit = navigate_to_staging_pose, max_staging_time_s
        self._charge_until = charge_until
        self._charged_at = math.inf
        """Last time at which the battery was charged (s)."""

    @property
    def is_charging(self) -> bool:
        """True while the docked robot waits for `charge_until`."""
        return not self.is_done and self._motion is not None and self._motion.is_done

    def start(self) -> None:
        """Send the staging pose as a goal, unless the robot is within dock_prestaging_tolerance of it and looks as it should.

        ROS differs: in Nav2 its heading does not count, so that it may look away from the dock.
        """
        super().start()
        staging = self.dock_type.staging_pose(self.dock.pose)
        try:
            here = self._move_base.global_costmap.robot_pose(self._now)
        except NavError as exc:
            self.end(GoalStatus.ABORTED, exc.message, exc)
            self._publish()
            return
        if self._navigates and not is_staged(here, staging, self.params):
            self.stage(staging, self._limit)
        else:
            self.staged()

    def staged(self) -> None:
        """Start the approach."""
        self.run(Approach("dock", self.params, self.dock, self.dock_type, self.sensing, self.log))

    def arrived(self, motion: MotionHandle) -> None:
        """End, or stay until the battery has its charge; with FailedToChargeError if the current ceases before."""
        until, battery = self._charge_until, self.sensing.battery
        if until is None or motion.error is not None or battery is None or battery.charge >= until:
            super().arrived(motion)
            return
        now, limit = self._now, self.params.wait_charge_timeout
        if not math.isfinite(self._charged_at) or self.dock_type.is_charging(battery, docked=True):
            self._charged_at = now
        if self.log.visits:
            self.log.visits[-1].end = now
        if now - self._charged_at > limit:
            error = FailedToChargeError(
                f"{self.dock.name}: the battery is no longer charged: {battery.current:.2f} A for {limit:g} s at a charge of "
                f"{battery.charge:.0%}, {until:.0%} were wanted",
                charge=battery.charge,
            )
            self.end(GoalStatus.ABORTED, error.message, error)

    def advance(self) -> None:
        """See `DockTask`."""
        if not self.is_done and self._goal is None and self._motion is None:
            self.staged()
        super().advance()


class Undocking(DockTask):
    """Drives out of a dock to its staging pose."""

    def __init__(
        self,
        move_base: MoveBase,
        database: DockDatabase,
        dock_type: str = "",
        *,
        max_undocking_time_s: float = MAX_UNDOCKING_TIME_S,
    ) -> None:
        """`dock_type`: name of the type, none for that of the nearest dock. Raises DockNotValidError."""
        dock = undocked_dock(move_base, database, dock_type)
        super().__init__(move_base, database, dock, database.type_named(dock.type), "undock")
        self._limit = max_undocking_time_s

    def start(self) -> None:
        """Start to drive out."""
        super().start()
        self._leave()

    def advance(self) -> None:
        """See `DockTask`."""
        if not self.is_done and self._motion is None:
            self._leave()
        super().advance()

    def _leave(self) -> None:
        motion = Leave("undock", self.params, self.dock, self.dock_type, self.sensing, self.log, max_time_s=self._limit)
        self.run(motion)
