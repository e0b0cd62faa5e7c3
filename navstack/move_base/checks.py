"""The checks of a control cycle: progress, stall, stale sensors, a lost robot. They report; `MoveBase` acts."""

from __future__ import annotations

import math
from enum import Enum
from typing import Final, Literal, NamedTuple

from navstack.core import FrameError, NavError, Pose2D, RobotState, Twist2D, angle_between
from navstack.move_base.active_goal import ActiveGoal
from navstack.move_base.control import ControlInputs
from navstack.move_base.costmaps import CostmapUpdater
from navstack.move_base.errors import LostError, NoProgressError, OdometryError, StaleSensorsError
from navstack.move_base.events import EventPublisher
from navstack.move_base.plugin_calls import call, checked_flag, checked_problems, checked_status
from navstack.move_base.schedule import EPSILON_S
from navstack.move_base.states import LOG_STALE, NavEvent
from navstack.plugins import CostmapServer, LocalizationStatus, Plan, ProgressChecker, Robot, VelocityLimits


class Verdict(NamedTuple):
    """What a check asks `MoveBase` to do."""

    event: NavEvent
    error: NavError | None = None
    """The reason."""


# --- progress; its absence is what move_base calls oscillation ---------------------------------------------------------

PROGRESS_ANGLE = 0.5
"""rad; as Nav2's PoseProgressChecker."""


class Progress(Enum):
    """What the robot did since its last progress."""

    NONE = "none"
    TURNED = "turned"
    MOVED = "moved"


class OscillationChecker:
    """Progress is a motion of `distance` (m) from the place of the last progress, or a turn to a new heading there.

    ROS differs: C++ counts distance only, so that a slow turn in place is "oscillating" (parity 24). Here a turn counts in
    steps of `angle` (rad) as long as it reaches new headings, up to a full turn at one place. A robot that swings back and
    forth, or spins without end, makes no progress.
    """

    def __init__(self, distance: float, angle: float = PROGRESS_ANGLE) -> None:
        self.distance = distance
        self.angle = angle
        self._reference: Pose2D | None = None
        self._yaw = 0.0
        self._heading = 0.0
        self._low = 0.0
        self._high = 0.0

    def reset(self) -> None:
        """Start again at the next pose."""
        self._reference = None

    def update(self, pose: Pose2D) -> Progress:
        """Return the progress of the robot, now at `pose`."""
        reference = self._reference
        if reference is None or pose.distance_to(reference) >= self.distance:
            self._reference = pose
            self._yaw = pose.yaw
            self._heading = self._low = self._high = 0.0
            return Progress.MOVED
        self._heading += angle_between(self._yaw, pose.yaw)
        self._yaw = pose.yaw
        if self._high - self._low >= 2.0 * math.pi:
            return Progress.NONE
        if self._heading >= self._high + self.angle:
            self._high = self._heading
            return Progress.TURNED
        if self._heading <= self._low - self.angle:
            self._low = self._heading
            return Progress.TURNED
        return Progress.NONE


# --- stall ------------------------------------------------------------------------------------------------------------

SLOWEST_M: Final = 0.05
"""Slower commands (m/s) are not expected to move a robot: friction, dead bands of the wheels."""
SLOWEST_RAD: Final = 0.2
"""Slower turns (rad/s) are not expected to move a robot."""
MOVED_M: Final = 0.02
"""A robot that has moved by this (m) is not stalled."""
MOVED_RAD: Final = 0.05
"""A robot that has turned by this (rad) is not stalled."""
MEASURED: Final = 0.3
"""A robot whose odometry measures this share of the commanded velocity is not stalled."""


class StallCheck:
    """Detects a robot that is commanded to move and does not: it pushes against something, or its wheels are blocked.

    ROS differs: move_base has no such check; the robot pushes until oscillation_timeout, which is off by default.

    A stalled robot counts as stalled until `reset`, as it stands then and nothing new can be measured.
    """

    def __init__(self) -> None:
        self.unproven = False
        """True from a stall until the robot has moved."""
        self._anchor: Pose2D | None = None
        self._since = 0.0
        self._error: NoProgressError | None = None

    def reset(self) -> None:
        """Allow commands again: a recovery behavior has ended. The robot has yet to prove that it moves."""
        self._anchor = self._error = None

    def check(self, state: RobotState, sent: Twist2D, limits: VelocityLimits, timeout_s: float, now: float) -> None:
        """Check the motion up to `now` (s). `state`: the odometry, `sent`: the command that the robot is executing.

        `timeout_s`: longest time (s) without motion, beyond the time to reach the commanded velocity. Raises NoProgressError from
        the time at which the robot counts as stalled until `reset`.
        """
        if self._error is not None:
            raise self._error
        anchor = self._anchor
        if anchor is not None and _has_moved(anchor, state, sent):
            self.unproven = False
            anchor = None
        speed, turn = math.hypot(sent.vx, sent.vy), abs(sent.wz)
        slowest = max(SLOWEST_M, 0.9 * min(limits.min_vel_trans, limits.max_vel_trans))
        slowest_turn = max(SLOWEST_RAD, 0.9 * min(limits.min_vel_theta, limits.max_vel_theta))
        if speed < slowest and turn < slowest_turn:
            self._anchor = None
            return
        if anchor is None:
            self._anchor, self._since = state.pose, now
            return
        allowed = timeout_s + max(
            _time_to(speed, limits.acc_lim_x, limits.acc_lim_y), _time_to(turn, limits.acc_lim_theta)
        )
        if now - self._since < allowed:
            return
        self.unproven = True
        self._error = NoProgressError(
            f"the robot does not move: for {now - self._since:.1f} s it was commanded ({sent.vx:.2f}, {sent.vy:.2f}) m/s, "
            f"{sent.wz:.2f} rad/s, and its odometry stayed within {MOVED_M:g} m and {MOVED_RAD:g} rad of "
            f"({anchor.x:.2f}, {anchor.y:.2f}); {_stall_cause(sent)} (navstack/stall_timeout)",
            command=list(sent),
            velocity=list(state.velocity),
            seconds=now - self._since,
            stall_timeout=timeout_s,
        )
        raise self._error


def _stall_cause(sent: Twist2D) -> str:
    """Return what may keep a robot from executing a command, in words."""
    if abs(sent.vy) > abs(sent.vx) and abs(sent.wz) < SLOWEST_RAD:
        return (
            "a differential base or a car cannot drive sideways: set holonomic_robot: false (TrajectoryPlannerROS) or "
            "max_vel_y: 0 and min_vel_y: 0 (DWAPlannerROS); a base that can may push against something, or its wheels may "
            "be blocked"
        )
    return (
        "it may push against something that its sensors do not see, its wheels may be blocked, or an emergency stop may be "
        "active"
    )


def _has_moved(anchor: Pose2D, state: RobotState, sent: Twist2D) -> bool:
    """Return True if the pose has changed, or the odometry measures a part of the commanded velocity."""
    pose, (vx, vy, wz) = state.pose, state.velocity
    if anchor.distance_to(pose) >= MOVED_M or abs(angle_between(anchor.yaw, pose.yaw)) >= MOVED_RAD:
        return True
    speed, turn = math.hypot(sent.vx, sent.vy), abs(sent.wz)
    return (speed >= SLOWEST_M and math.hypot(vx, vy) >= MEASURED * speed) or (
        turn >= SLOWEST_RAD and abs(wz) >= MEASURED * turn
    )


def _time_to(speed: float, *accelerations: float) -> float:
    """Return the time (s) to reach a speed; 0 without a limit, at most 1 s."""
    limits = [a for a in accelerations if a > 0.0 and math.isfinite(a)]
    return min(speed / min(limits), 1.0) if limits else 0.0


def check_progress(checker: ProgressChecker, pose: Pose2D, now: float) -> NavError | None:
    """Return why a progress checker ends the patience with the robot, at `pose` at `now` (s); None while it makes progress."""
    try:
        if call(checker, checker.makes_progress, pose, now, check=checked_flag):
            return None
        return NoProgressError(f"the robot {call(checker, getattr, checker, 'failure')}", pose=pose)
    except NavError as exc:
        return exc


# --- stale sensors ----------------------------------------------------------------------------------------------------


class StaleSensorCheck:
    """Reports inputs of the control cycle that must not be used, until controller_patience ends the goal (parity 23).

    The inputs are the local costmap, the transform of the plan (while controlling) and the odometry.
    """

    def __init__(
        self, costmap: CostmapServer, costmaps: CostmapUpdater, inputs: ControlInputs, events: EventPublisher
    ) -> None:
        """`costmap` is the local one."""
        self._costmap = costmap
        self._costmaps = costmaps
        self._inputs = inputs
        self._events = events

    def check(self, goal: ActiveGoal, plan: Plan | None, patience_s: float, now: float) -> Verdict | None:
        """Return what follows if the robot must not move at `now` (s). `plan`: the plan that it follows, if it does."""
        costmap, cause = self._costmap, self._costmaps.local_error
        try:
            stale = cause is not None or not call(costmap, costmap.is_current, now, check=checked_flag)
        except NavError as exc:
            stale, cause = True, exc
        if not stale:
            cause = self._input_error(plan, now)
            if cause is None:
                goal.stale_since = None
                return None
        if goal.stale_since is None:
            goal.stale_since = now
            if isinstance(cause, (OdometryError, FrameError)) and self._costmaps.local_error is None:
                text = f"the robot is stopped: {cause.message}"
            else:
                text = LOG_STALE.format(name=costmap.name)
            self._events.warn(now, text, cause)
        goal.statistics.stale_cycles += 1
        if now - goal.stale_since < patience_s - EPSILON_S:
            return Verdict(NavEvent.SENSORS_STALE)
        error = cause or self._timeout(goal, patience_s)
        goal.statistics.add_failure(error, now)
        return Verdict(NavEvent.SENSORS_LOST, error)

    def _input_error(self, plan: Plan | None, now: float) -> NavError | None:
        """Return why the odometry or the transform of the plan must not be used at `now` (s).

        Other errors of the robot fail the control cycle, as in C++.
        """
        try:
            self._inputs.state(now)
        except OdometryError as exc:
            return exc
        except NavError:
            return None  # reported by the control cycle or the recovery behavior
        try:
            if plan is not None:
                self._inputs.plan_transform(plan, now)
        except NavError as exc:
            return exc
        return None

    def _timeout(self, goal: ActiveGoal, patience_s: float) -> NavError:
        what = f"has been stale (no usable data within its expected_update_rate) for controller_patience ({patience_s:g} s)"
        return stale_sensors(self._costmap, what, goal.stale_since)


def stale_sensors(costmap: CostmapServer, what: str, since: float | None = None) -> StaleSensorsError:
    """Return the error of a costmap a sensor of which `what` since the time `since` (s), with what the costmap reports."""
    try:
        problems = call(costmap, costmap.problems, check=checked_problems)
    except NavError as exc:
        problems = (exc,)
    reasons = "; ".join(problem.message for problem in problems) or "check the sensor and its topic"
    return StaleSensorsError(
        f"a sensor of {costmap.name} {what}; {reasons}",
        costmap=costmap.name,
        since=since,
        problems=[problem.as_dict() for problem in problems],
    )


# --- lost -------------------------------------------------------------------------------------------------------------

LostAction = Literal["recover", "stop", "ignore"]
_KNOWN: Final = LocalizationStatus()
_UNEXPLAINED: Final = "its localization reports that it is lost"


class LostCheck:
    """Publishes when the robot is lost and when it has found itself, and reports that it must wait meanwhile.

    ROS differs: amcl does not report it, and move_base drives on.
    """

    def __init__(self, robot: Robot, events: EventPublisher) -> None:
        self.action: LostAction = "recover"
        """recover: run the recovery behaviors, then wait; stop: wait; ignore: drive on."""
        self.timeout_s = 60.0
        """A goal that has waited this long (s) for a lost robot is aborted."""
        self.is_lost = False
        self._robot = robot
        self._events = events
        self._status = _KNOWN
        self._failed = False
        self._lost_at = 0.0
        """Time (s) at which the robot last began to be lost."""

    def observe(self, now: float) -> bool:
        """Read the status at `now` (s) and publish a change; return True if the robot has found itself.

        What was marked and planned from its previous poses is wrong then. With the action "ignore" this is False.
        """
        events, robot = self._events, self._robot
        try:
            status = call(robot, getattr, robot, "localization_status", None, check=checked_status)
        except NavError as exc:
            if not self._failed:
                events.warn(now, f"it is not known whether the robot is lost: {exc.message}", exc)
            self._failed = True
            return False
        if status is None:
            return False
        before, self._status = self._status, status
        if status.lost == before.lost:
            return False
        self.is_lost = status.lost
        if status.lost:
            self._lost_at = now
            events.warn(now, status.text or _UNEXPLAINED, self._error(status))
            return False
        since = self._lost_at
        events.info(now, f"the robot is localized again, after {now - since:.1f} s", lost=False, lost_since=since)
        return self.action != "ignore"

    def check(self, goal: ActiveGoal, recovery_left: bool, now: float) -> Verdict | None:
        """Return what follows at `now` (s) while the robot is lost: a recovery, or waiting until `timeout_s`."""
        status = self._status
        if not status.lost or self.action == "ignore":
            return None
        if self.action == "recover" and recovery_left:
            goal.lost = self._error(status)
            return Verdict(NavEvent.LOST, goal.lost)
        waited = now - max(self._lost_at, goal.handle.accepted_at or 0.0)
        if waited < self.timeout_s - EPSILON_S:
            return Verdict(NavEvent.LOST_WAITING)
        goal.lost = error = self._error(status, f" for {waited:.0f} s (navstack/lost_timeout {self.timeout_s:g} s)")
        goal.statistics.add_failure(error, now)
        return Verdict(NavEvent.LOST_TOO_LONG, error)

    def _error(self, status: LocalizationStatus, waited: str = "") -> LostError:
        return LostError(
            f"the robot does not know where it is{waited}: {status.text or _UNEXPLAINED}",
            since=status.since,
            explained=status.explained,
        )
