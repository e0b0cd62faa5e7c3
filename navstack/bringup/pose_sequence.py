"""Drives to several poses in order by goals of a `MoveBase`: through all but the last, or with a stop at each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Final, NamedTuple

from navstack.core import Pose2D
from navstack.move_base import GoalHandle, GoalStatus, MoveBase

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


@dataclass(frozen=True, slots=True)
class MissedPose:
    """A pose that was not reached."""

    index: int
    code: int
    text: str


class PoseSequence:
    """One drive. The owner ticks the goal manager and calls `update`."""

    def __init__(
        self,
        move_base: MoveBase,
        targets: Sequence[TargetPose],
        *,
        through: bool,
        stop_on_failure: bool,
        first: int = 0,
    ) -> None:
        """`through`: intermediate poses are passed within PASSED_RADIUS_M without a stop. `first`: index of the first pose."""
        self.targets = tuple(targets)
        self.index = first
        self.missed: list[MissedPose] = []
        self.past_recoveries = 0
        """Of the poses before the current one."""
        self.result: TaskResult | None = None
        """None until the end."""
        self.error: tuple[int, str] = NO_ERROR
        """Code and reason of the last failure."""
        self._move_base = move_base
        self._through, self._stop_on_failure = through, stop_on_failure
        self.handle = self._send()

    def _send(self) -> GoalHandle:
        pose, frame, orientation = self.targets[self.index]
        return self._move_base.send_goal(pose, frame, orientation=orientation)

    def update(self) -> None:
        """Send the next pose once the robot has reached or passed the current one; set the result at the end."""
        if self.result is not None:
            return
        handle, last = self.handle, self.index + 1 == len(self.targets)
        if not handle.is_done:
            if self._through and not last and self._has_passed(handle):
                self.past_recoveries += self._move_base.feedback.recoveries
                self._next()
            return
        result = handle.result
        if handle.status is not GoalStatus.SUCCEEDED:
            self.error = (result.error_code, result.message or handle.text)
        if handle.status in (GoalStatus.PREEMPTED, GoalStatus.RECALLED):
            self.result = TaskResult.CANCELED
            return
        self.past_recoveries += result.recoveries
        if handle.status is not GoalStatus.SUCCEEDED:
            self.missed.append(MissedPose(self.index, *self.error))
            if self._through or self._stop_on_failure:
                self.result = TaskResult.FAILED
                return
        if last:
            self.result = TaskResult.FAILED if self.missed else TaskResult.SUCCEEDED
        else:
            self._next()

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

    def _next(self) -> None:
        self.index += 1
        self.handle = self._send()
