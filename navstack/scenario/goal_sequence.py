"""The goals of a run: sent one after another, or at once in place of the present one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from navstack.core import Pose2D, angle_between
from navstack.move_base import GoalHandle, MoveBase
from navstack.scenario.measurements import RunMeasurements
from navstack.scenario.outcome import GoalOutcome
from navstack.sim import SimulatedRobot


@dataclass(frozen=True, slots=True)
class SentGoal:
    """A goal that has been sent."""

    index: int
    pose: Pose2D
    handle: GoalHandle
    time: float
    """When it was sent (s)."""
    length: float
    """Distance driven until then (m)."""


class GoalSequence:
    """Waiting goals, the goals that are under way (two while one replaces another), and the outcomes of the others."""

    def __init__(
        self,
        goals: Sequence[Pose2D],
        robot: SimulatedRobot,
        measurements: RunMeasurements,
        *,
        pause_s: float,
        stop_on_failure: bool,
    ) -> None:
        self.waiting = list(goals)
        self.loop = False
        """Append each goal again when it is sent."""
        self.under_way: list[SentGoal] = []
        self.outcomes: list[GoalOutcome] = []
        self.pause_until = 0.0
        """Earliest time for the next goal (s)."""
        self._sent = 0
        self._skipped = 0
        self._robot, self._measurements = robot, measurements
        self._pause_s, self._stop_on_failure = pause_s, stop_on_failure

    @property
    def last_index(self) -> int:
        """Index of the goal sent last, -1 before the first one."""
        return self._sent - 1

    @property
    def total(self) -> int:
        """Number of goals sent, waiting or skipped after a failure."""
        return self._sent + len(self.waiting) + self._skipped

    def send_next(self, move_base: MoveBase) -> SentGoal | None:
        """Sends the first waiting goal; None if there is none."""
        if not self.waiting:
            return None
        goal = self.waiting.pop(0)
        if self.loop:
            self.waiting.append(goal)
        return self.send(goal, move_base)

    def send(self, goal: Pose2D, move_base: MoveBase) -> SentGoal:
        """Sends a goal, which replaces the one under way."""
        sent = SentGoal(self._sent, goal, move_base.send_goal(goal), self._robot.time, self._measurements.path_length)
        self._sent += 1
        self.under_way.append(sent)
        return sent

    def finish_ended(self) -> None:
        """Stores the outcomes of the goals that have ended; after the last one under way, the pause begins."""
        ended = [sent for sent in self.under_way if sent.handle.is_done]
        if not ended:
            return
        self.under_way = [sent for sent in self.under_way if not sent.handle.is_done]
        self.outcomes += [self._outcome(sent) for sent in ended]
        if self.under_way:
            return
        if self._stop_on_failure and not self.outcomes[-1].succeeded:
            self.skip_waiting()
        if self.waiting:
            self.pause_until = self._robot.time + self._pause_s

    def skip_waiting(self) -> None:
        """Drops the waiting goals; they still count as goals of the run."""
        self._skipped += len(self.waiting)
        self.waiting.clear()

    def cancel_expired(self, move_base: MoveBase, limit_s: float) -> None:
        """Cancels the goals that have been under way for longer than the limit (s)."""
        for sent in self.under_way:
            if self._robot.time - sent.time > limit_s:
                move_base.cancel_goal(sent.handle)

    def _outcome(self, sent: SentGoal) -> GoalOutcome:
        robot, goal, result = self._robot, sent.pose, sent.handle.result
        return GoalOutcome(
            goal=goal,
            state=sent.handle.status.name,
            text=sent.handle.text,
            error_code=result.error_code,
            error_name=result.error_name,
            message=result.message,
            time_s=robot.time - sent.time,
            path_length_m=self._measurements.path_length - sent.length,
            distance_left_m=robot.pose.distance_to(goal),
            yaw_left_rad=abs(angle_between(robot.pose.yaw, goal.yaw)),
            recoveries=result.recoveries,
        )
