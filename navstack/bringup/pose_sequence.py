"""Drives to several poses in order by goals of a `MoveBase`: through all but the last, or with a stop and a task at each."""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from typing import Final, NamedTuple

from navstack.behaviors import (
    NO_EXECUTOR,
    ExecutorFailedError,
    MissedWaypointError,
    WaypointExecutor,
    WaypointReport,
    WaypointStatus,
)
from navstack.core import NavError, Pose2D
from navstack.move_base import GoalHandle, GoalStatus, MoveBase
from navstack.plugins import Behavior

PASSED_RADIUS_M: Final = 0.7
"""Distance at which an intermediate pose counts as passed (Nav2's RemovePassedGoals)."""
NO_ERROR: Final = (0, "")


class TaskResult(Enum):
    """Result of a task, with Nav2's numbers."""

    UNKNOWN = 0
    SUCCEEDED = 1
    CANCELED = 2
    FAILED = 3


class TargetPose(NamedTuple):
    """A pose to drive to."""

    pose: Pose2D
    frame: str | None = None
    """None for the global costmap's frame."""
    orientation: tuple[float, float, float, float] | None = None
    """A quaternion (x, y, z, w), whose heading replaces that of the pose."""


class PoseSequence:
    """One drive. The owner ticks the goal manager, calls `update`, and runs the task of a waypoint."""

    def __init__(
        self,
        move_base: MoveBase,
        targets: Sequence[TargetPose],
        *,
        through: bool,
        stop_on_failure: bool,
        first: int = 0,
        loops: int = 0,
        executor: WaypointExecutor = NO_EXECUTOR,
        now: float = 0.0,
    ) -> None:
        """Send the first pose.

        `through`: intermediate poses are passed within PASSED_RADIUS_M without a stop. `first`: index of the first pose.
        `loops`: how many times more all poses are driven to. `executor`: what is done where the robot stops.
        """
        self.targets = tuple(targets)
        self.index = first
        self.loop = 0
        """0 for the first pass."""
        self.reports: list[WaypointReport] = []
        """How the poses went, in the order in which they were driven to."""
        self.task: Behavior | None = None
        """What is to run at the current pose; the owner runs it and calls `end_task`."""
        self.past_recoveries = 0
        """Of the poses before the current one."""
        self.result: TaskResult | None = None
        """None until the end."""
        self.error: tuple[int, str] = NO_ERROR
        """Code and reason of the last failure."""
        self._move_base = move_base
        self._through, self._stop_on_failure = through, stop_on_failure
        self._executor, self._loops = executor, loops
        self._set_out = now
        self.handle = self._send()

    @property
    def missed(self) -> list[WaypointReport]:
        """The poses that were not reached, or whose task failed."""
        return [report for report in self.reports if report.waypoint_status is WaypointStatus.FAILED]

    def _send(self) -> GoalHandle:
        pose, frame, orientation = self.targets[self.index]
        return self._move_base.send_goal(pose, frame, orientation=orientation)

    def update(self, now: float) -> None:
        """Send the next pose once the robot has reached or passed the current one; set the result at the end."""
        if self.result is not None or self.task is not None:
            return
        handle, last = self.handle, self.index + 1 == len(self.targets)
        if not handle.is_done:
            if self._through and not last and self._has_passed(handle):
                self.past_recoveries += self._move_base.feedback.recoveries
                self._end_pose(None, now)
            return
        result = handle.result
        if handle.status in (GoalStatus.PREEMPTED, GoalStatus.RECALLED):
            self.error = (result.error_code, result.message or handle.text)
            self.result = TaskResult.CANCELED
            return
        self.past_recoveries += result.recoveries
        if handle.status is not GoalStatus.SUCCEEDED:
            self._end_pose((result.error_code, result.message or handle.text), now)
        elif self._through:
            self._end_pose(None, now)
        else:
            self._execute(now)

    def end_task(self, error: NavError | None, now: float) -> None:
        """Go on after the task of the current pose."""
        self.task = None
        self._end_pose(None if error is None else self._task_failed(error.message), now)

    def _execute(self, now: float) -> None:
        """Do the task of a pose that was reached."""
        try:
            found = self._executor(self.index, self.targets[self.index].pose)
        except Exception as exc:  # whatever a function of the user raises is the failure of this waypoint
            why = exc.message if isinstance(exc, NavError) else f"{type(exc).__name__}: {exc}"
            self._end_pose(self._task_failed(why), now)
            return
        if isinstance(found, Behavior):
            self.task = found
            return
        self._end_pose(self._task_failed("") if found is False else None, now)

    def _task_failed(self, why: str) -> tuple[int, str]:
        text = f"the task at waypoint {self.index} failed"
        return ExecutorFailedError.code, f"{text}: {why}" if why else text

    def _end_pose(self, error: tuple[int, str] | None, now: float) -> None:
        """Report the current pose, and go on to the next one, or end."""
        code, text = error or NO_ERROR
        status = WaypointStatus.COMPLETED if error is None else WaypointStatus.FAILED
        pose = self.targets[self.index].pose
        self.reports.append(WaypointReport(self.index, pose, status, code, text, self.loop, self._set_out, now))
        if error is not None:
            self.error = error
            if self._through or self._stop_on_failure:
                if not self._through and len(self.targets) > 1 and code != ExecutorFailedError.code:
                    self.error = (MissedWaypointError.code, f"waypoint {self.index} was missed: {text} ({code})")
                self._skip_rest(now)
                self.result = TaskResult.FAILED
                return
        if self.index + 1 < len(self.targets):
            self._next(self.index + 1, now)
        elif self.loop < self._loops:
            self.loop += 1
            self._next(0, now)
        else:
            self.result = TaskResult.FAILED if self.missed else TaskResult.SUCCEEDED

    def _skip_rest(self, now: float) -> None:
        """Report the poses of this loop that are left out."""
        for index, target in enumerate(self.targets[self.index + 1 :], self.index + 1):
            self.reports.append(
                WaypointReport(index, target.pose, WaypointStatus.SKIPPED, loop=self.loop, started_s=now, ended_s=now)
            )

    def cancel(self) -> None:
        """Cancel the drive; it ends with the current goal, within one control cycle."""
        self._move_base.cancel_goal(self.handle)

    def remaining(self) -> tuple[float, float | None]:
        """Return the distance to drive (m), along the plan and then straight from pose to pose, and the time for it (s).

        The time, at the mean speed so far, is None while that is unknown.
        """
        now = self._move_base.feedback
        left = now.distance_remaining
        for a, b in zip(self.targets[self.index :], self.targets[self.index + 1 :]):
            left += a.pose.distance_to(b.pose)
        if now.estimated_time_remaining is None or now.distance_remaining <= 0.0:
            return left, None
        return left, now.estimated_time_remaining / now.distance_remaining * left

    def _has_passed(self, handle: GoalHandle) -> bool:
        robot, goal = self._move_base.robot_pose, self._move_base.goal_pose
        if self._move_base.goal_handle is not handle or robot is None or goal is None:
            return False
        return robot.distance_to(goal) <= PASSED_RADIUS_M

    def _next(self, index: int, now: float) -> None:
        self.index, self._set_out = index, now
        self.handle = self._send()
