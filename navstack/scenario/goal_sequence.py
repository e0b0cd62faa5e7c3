"""The goals and motions of a run: sent one after another, or a goal at once in place of the current one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from navstack.core import Pose2D, angle_between, jsonable
from navstack.move_base import GoalHandle, GoalTimeLimitError, MotionHandle, MoveBase
from navstack.plugins import Behavior
from navstack.scenario.outcome import GoalOutcome, RunMeasurements
from navstack.scenario.steps import Step, step_text
from navstack.sim import SimulatedRobot


@dataclass(frozen=True, slots=True)
class SentGoal:
    """A goal, or a motion, that has been sent."""

    index: int
    pose: Pose2D | None
    """The goal; None for a motion, whose target is known after its first step."""
    handle: GoalHandle | MotionHandle
    step: str
    """The motion in words; empty for a goal."""
    time: float
    """When it was sent (s)."""
    length: float
    """Distance driven until then (m)."""

    @property
    def target(self) -> Pose2D | None:
        """Where the robot should be at the end; None if that is not known (yet)."""
        return self.handle.target if isinstance(self.handle, MotionHandle) else self.pose

    def cancel(self, move_base: MoveBase) -> None:
        """Cancels it."""
        if isinstance(self.handle, GoalHandle):
            move_base.cancel_goal(self.handle)
        elif move_base.motions.running is self.handle:
            move_base.motions.cancel()


class GoalSequence:
    """Waiting goals, the goals that are under way (two while one replaces another), and the outcomes of the others."""

    def __init__(
        self,
        goals: Sequence[Pose2D | Step],
        robot: SimulatedRobot,
        measurements: RunMeasurements,
        *,
        make_motion: Callable[[Step], Behavior],
        pause_s: float,
        time_limit_s: float,
        stop_on_failure: bool,
    ) -> None:
        """`time_limit_s` is that of a goal or motion: it is aborted then, as by `navstack/goal_time_limit`."""
        self.waiting: list[Pose2D | Step] = list(goals)
        self.loop = False
        """Append each goal again when it is sent."""
        self.under_way: list[SentGoal] = []
        self.outcomes: list[GoalOutcome] = []
        self.pause_until = 0.0
        """Earliest time for the next goal (s)."""
        self._sent = 0
        self._skipped = 0
        self._robot, self._measurements = robot, measurements
        self._make_motion = make_motion
        self._pause_s, self._time_limit_s, self._stop_on_failure = pause_s, time_limit_s, stop_on_failure

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

    def send(self, goal: Pose2D | Step, move_base: MoveBase) -> SentGoal:
        """Sends a goal, which replaces the one under way, or starts a motion."""
        at = (self._robot.time, self._measurements.path_length)
        if isinstance(goal, Pose2D):
            limit = min(self._time_limit_s, move_base.goal_time_limit_s)
            sent = SentGoal(self._sent, goal, move_base.send_goal(goal, time_limit_s=limit), "", *at)
        else:
            sent = SentGoal(self._sent, None, move_base.motions.start(self._make_motion(goal)), step_text(goal), *at)
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

    def end_expired_motion(self, move_base: MoveBase) -> None:
        """Aborts the running motion if it has been under way for longer than the time limit; goals have their own."""
        limit = self._time_limit_s
        for sent in self.under_way:
            if sent.handle is move_base.motions.running and self._robot.time - sent.time > limit:
                text = f"{sent.step} did not end within the time limit of {limit:g} s"
                move_base.motions.cancel(GoalTimeLimitError(text, time_limit_s=limit))

    def _outcome(self, sent: SentGoal) -> GoalOutcome:
        robot, result = self._robot, sent.handle.result
        goal = sent.target or robot.pose
        motion = sent.handle if isinstance(sent.handle, MotionHandle) else None
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
            step=sent.step,
            figures=jsonable(motion.data) if motion is not None else {},
        )
