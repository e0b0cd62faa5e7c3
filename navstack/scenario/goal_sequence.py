"""The goals and motions of a run: sent one after another, or a goal at once in place of the current one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from navstack.behaviors import GoToStep
from navstack.bringup import PASSED_RADIUS_M
from navstack.core import Pose2D, angle_between, jsonable
from navstack.docking import DockDatabase, Docking, DockTask
from navstack.move_base import GoalHandle, GoalResult, GoalStatus, GoalTimeLimitError, MotionHandle, MoveBase
from navstack.plugins import Behavior
from navstack.scenario.low_battery import ChargingErrand, LowBattery
from navstack.scenario.outcome import GoalOutcome, RunMeasurements
from navstack.scenario.steps import DockStep, Step, UndockStep, step_text
from navstack.sim import SimulatedRobot


@dataclass(frozen=True, slots=True)
class SentGoal:
    """A goal, or a motion, that has been sent."""

    index: int
    pose: Pose2D | None
    """The goal; None for a motion, whose target is known after its first step."""
    handle: GoalHandle | MotionHandle | DockTask | ChargingErrand
    step: str
    """The motion in words; empty for a goal."""
    time: float
    """When it was sent (s)."""
    length: float
    """Distance driven until then (m)."""

    @property
    def target(self) -> Pose2D | None:
        """Where the robot should be at the end; None if that is not known (yet)."""
        return self.handle.target if isinstance(self.handle, (MotionHandle, DockTask)) else self.pose

    def cancel(self, move_base: MoveBase) -> None:
        """Cancels it."""
        if isinstance(self.handle, GoalHandle):
            move_base.cancel_goal(self.handle)
        elif isinstance(self.handle, (DockTask, ChargingErrand)):
            self.handle.cancel()
        elif move_base.motions.running is self.handle:
            move_base.motions.cancel()


class GoalSequence:
    """Waiting goals, the goals that are under way (two while one replaces another), and the outcomes of the others."""

    def __init__(
        self,
        goals: Sequence[Pose2D | Step | Behavior],
        robot: SimulatedRobot,
        measurements: RunMeasurements,
        *,
        make_motion: Callable[[Step], Behavior],
        pause_s: float,
        time_limit_s: float,
        stop_on_failure: bool,
        pass_through: bool = False,
        make_task: Callable[[DockStep | UndockStep], DockTask],
        docks: DockDatabase,
        low_battery: LowBattery | None = None,
    ) -> None:
        """`pass_through`: a goal counts as reached within PASSED_RADIUS_M, and the next one replaces it.

        `time_limit_s` is that of a goal or motion: it is aborted then, as by `navstack/goal_time_limit`.
        """
        self.waiting: list[Pose2D | Step | Behavior] = list(goals)
        self.loop = False
        """Append each goal again when it is sent."""
        self.under_way: list[SentGoal] = []
        self.outcomes: list[GoalOutcome] = []
        self.pause_until = 0.0
        """Earliest time for the next goal (s)."""
        self.urgent: Pose2D | Step | None = None
        """The step that begins as soon as nothing is under way, before the waiting ones."""
        self._pass_through = pass_through
        self._passed: set[int] = set()
        """Indices of the goals that were passed."""
        self._sent = 0
        self._skipped = 0
        self._robot, self._measurements = robot, measurements
        self._make_motion, self._make_task = make_motion, make_task
        self._docks, self._low_battery = docks, low_battery
        self._pause_s, self._time_limit_s, self._stop_on_failure = pause_s, time_limit_s, stop_on_failure

    @property
    def last_index(self) -> int:
        """Index of the goal sent last, -1 before the first one."""
        return self._sent - 1

    @property
    def total(self) -> int:
        """Number of goals sent, waiting or skipped after a failure."""
        return self._sent + len(self.waiting) + self._skipped + (self.urgent is not None)

    def send_next(self, move_base: MoveBase) -> SentGoal | None:
        """Sends the first waiting goal; None if there is none."""
        if self.urgent is not None:
            step, self.urgent = self.urgent, None
            return self.send(step, move_base)
        if not self.waiting:
            return None
        goal = self.waiting.pop(0)
        if self.loop:
            self.waiting.append(goal)
        return self.send(goal, move_base)

    def begin_now(self, step: Step, move_base: MoveBase) -> None:
        """Cancels what is under way, and begins a step as soon as that has ended; the waiting goals follow.

        Raises the errors of a step that this robot cannot do; nothing has changed then.
        """
        self.check(step)
        for sent in self.under_way:
            sent.cancel(move_base)
        self.pause_until = self._robot.time
        self.urgent = step.pose if isinstance(step, GoToStep) else step

    def check(self, step: Pose2D | Step | Behavior) -> None:
        """Raises the error of a step that this robot cannot do."""
        if isinstance(step, DockStep):
            self._docks.type_of(self._docks.dock(step.dock))
        elif not isinstance(step, (Pose2D, GoToStep, UndockStep, Behavior)):
            self._make_motion(step)

    def pass_on(self, move_base: MoveBase) -> SentGoal | None:
        """Sends the next goal in place of one that the robot passes; None otherwise."""
        if not self._pass_through or len(self.under_way) != 1 or not self.waiting:
            return None
        current, following = self.under_way[0], self.waiting[0]
        if current.pose is None or not isinstance(following, Pose2D) or current.handle.is_done:
            return None
        if move_base.goal_handle is not current.handle or self._robot.pose.distance_to(current.pose) > PASSED_RADIUS_M:
            return None
        self._passed.add(current.index)
        return self.send_next(move_base)

    def send(self, goal: Pose2D | Step | Behavior, move_base: MoveBase) -> SentGoal:
        """Sends a goal, which replaces the one under way, or starts a motion."""
        at = (self._robot.time, self._measurements.path_length)
        if isinstance(goal, Pose2D):
            limit = min(self._time_limit_s, move_base.goal_time_limit_s)
            sent = SentGoal(self._sent, goal, move_base.send_goal(goal, time_limit_s=limit), "", *at)
        elif isinstance(goal, (DockStep, UndockStep)):
            task = self._make_task(goal)
            task.start()
            sent = SentGoal(self._sent, None, task, step_text(goal), *at)
        elif isinstance(goal, Behavior):
            sent = SentGoal(self._sent, None, move_base.motions.start(goal), goal.name, *at)
        else:
            sent = SentGoal(self._sent, None, move_base.motions.start(self._make_motion(goal)), step_text(goal), *at)
        self._sent += 1
        self.under_way.append(sent)
        return sent

    @property
    def is_charging(self) -> bool:
        """True while the robot stands in a dock until it has its charge."""
        for sent in self.under_way:
            task = sent.handle.task if isinstance(sent.handle, ChargingErrand) else sent.handle
            if isinstance(task, Docking) and task.is_charging:
                return True
        return False

    def advance_tasks(self, move_base: MoveBase) -> None:
        """Go on with docking after a tick; interrupt a goal if the battery is low, and send it again afterwards."""
        for number, sent in enumerate(self.under_way):
            handle = sent.handle
            if isinstance(handle, (DockTask, ChargingErrand)):
                handle.advance()
            if isinstance(handle, ChargingErrand) and handle.is_over and sent.pose is not None:
                limit = min(self._time_limit_s, move_base.goal_time_limit_s)
                self.under_way[number] = replace(sent, handle=move_base.send_goal(sent.pose, time_limit_s=limit))
        rule, battery = self._low_battery, self._robot.battery_state
        if rule is None or battery is None or battery.charge >= rule.threshold or len(self.under_way) != 1:
            return
        sent = self.under_way[0]
        if isinstance(sent.handle, GoalHandle) and not sent.handle.is_done:
            errand = ChargingErrand(rule, sent.handle, move_base, self._docks, battery.charge)
            self.under_way[0] = replace(sent, handle=errand)

    def finish_ended(self) -> None:
        """Stores the outcomes of the goals that have ended; after the last one under way, the pause begins."""
        ended = [sent for sent in self.under_way if sent.handle.is_done]
        if not ended:
            return
        self.under_way = [sent for sent in self.under_way if not sent.handle.is_done]
        self.outcomes += [self._outcome(sent) for sent in ended]
        if self.under_way or self.urgent is not None:
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
            elif isinstance(sent.handle, DockTask) and not self.is_charging and self._robot.time - sent.time > limit:
                text = f"{sent.step} did not end within the time limit of {limit:g} s"
                sent.handle.cancel(GoalTimeLimitError(text, time_limit_s=limit))

    def _outcome(self, sent: SentGoal) -> GoalOutcome:
        robot, result = self._robot, sent.handle.result
        goal = sent.target or robot.pose
        motion = sent.handle if isinstance(sent.handle, (MotionHandle, DockTask)) else None
        if sent.index in self._passed:
            result = GoalResult(GoalStatus.SUCCEEDED, f"passed within {PASSED_RADIUS_M:g} m without a stop")
        return GoalOutcome(
            goal=goal,
            state=result.status.name if sent.index in self._passed else sent.handle.status.name,
            text=result.text if sent.index in self._passed else sent.handle.text,
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
