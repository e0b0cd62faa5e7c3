"""Nav2's simple commander on a `MoveBase`: the method names that its scripts use, in camelCase for that reason.

Source of names and meanings: nav2_simple_commander (robot_navigator.py). What has no meaning without ROS (lifecycle,
localisation, behaviour trees) is not here.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Final

from navstack.bringup import build_move_base, simulated_robot
from navstack.core import Costmap, Listener, OccupancyGrid, Path, Pose2D, Twist2D
from navstack.core.errors import InputError, InternalError, NavError
from navstack.interfaces import RecoveryBehavior, RecoveryStatus
from navstack.move_base import GoalHandle, GoalStatus, MoveBase
from navstack.move_base.errors import GoalCanceledError, StaleSensorsError
from navstack.parameters.configuration import Configuration
from navstack.recovery import (
    BackUp,
    BackUpParams,
    DriveOnHeading,
    DriveOnHeadingParams,
    Spin,
    SpinParams,
)

POLL_S: Final = 0.1
"""How long `isTaskComplete` lets the world go on, as in Nav2."""
PASSED_RADIUS_M: Final = 0.7
"""How near counts as having passed a pose on the way (Nav2's RemovePassedGoals)."""
EPSILON_S: Final = 1e-6
NO_ERROR: Final = (0, "")


class TaskResult(Enum):
    """How a task ended; Nav2's numbers."""

    UNKNOWN = 0
    SUCCEEDED = 1
    CANCELED = 2
    FAILED = 3


@dataclass(frozen=True, slots=True)
class TaskFeedback:
    """Where the robot stands with its task."""

    current_pose: Pose2D | None
    """In the global costmap's frame; None when it is not known."""
    distance_remaining: float
    """m along the plan, then straight from pose to pose. For a behaviour what it has left, in its own unit (m, rad)."""
    navigation_time: float
    """s since the task began."""
    estimated_time_remaining: float | None
    """s at the mean speed so far; None while that says nothing."""
    number_of_recoveries: int
    number_of_poses_remaining: int
    """Of the task, the present one included."""
    current_waypoint: int
    """Index of the pose the robot is on its way to."""


class BasicNavigator:
    """One task at a time: a pose, poses to go through, waypoints to stop at, or a behaviour (spin, backup).

        navigator.goToPose(goal)
        while not navigator.isTaskComplete():
            print(navigator.getFeedback())
        print(navigator.getResult())

    Every `isTaskComplete` lets the world go on by `POLL_S`; nothing moves in between.
    """

    def __init__(self, move_base: MoveBase, advance: Callable[[float], float]) -> None:
        """`advance(t)` lets the world go on until `t` (s) and gives the time: of a simulation, its `advance_to`; live, it
        sleeps. For times that are past it returns at once.
        """
        self.move_base = move_base
        self.missed_waypoints: list[int] = []
        """Indices of the waypoints of the last followWaypoints that were not reached."""
        self._advance = advance
        self._now = advance(0.0)
        self._begun = self._now
        self._poses: tuple[Pose2D, ...] = ()
        self._frame: str | None = None
        self._index = 0
        self._through = False
        self._stop_on_failure = True
        self._handle: GoalHandle | None = None
        self._past_recoveries = 0
        self._behavior: RecoveryBehavior | None = None
        self._next_step = 0.0
        self._left = 0.0
        self._result: TaskResult | None = TaskResult.UNKNOWN
        self._error: tuple[int, str] = NO_ERROR

    @classmethod
    def simulated(
        cls,
        configuration: Configuration,
        static_map: OccupancyGrid,
        start: Pose2D,
        *,
        obstacles: Sequence[tuple[float, float, float]] = (),
        seed: int = 0,
        listeners: Sequence[Listener] = (),
    ) -> BasicNavigator:
        """A navigator of a simulated robot at `start`; raises as `navstack.simulated_robot` does."""
        robot = simulated_robot(configuration, static_map, start, obstacles=obstacles, seed=seed)
        move_base = build_move_base(configuration, robot, static_map=static_map, listeners=listeners)

        def advance(until: float) -> float:
            if until > robot.time:
                robot.advance_to(until)
            return robot.time

        return cls(move_base, advance)

    # --- tasks --------------------------------------------------------------------------------------------------------

    def goToPose(self, pose: Pose2D, frame: str | None = None) -> bool:
        """Drives to `pose` (in the global costmap's frame unless given); whatever was under way ends. True: accepted."""
        return self._set_out((pose,), frame, through=False, stop_on_failure=True)

    def goThroughPoses(self, poses: Sequence[Pose2D], frame: str | None = None) -> bool:
        """Drives to the last pose by way of the others, which it need only pass within PASSED_RADIUS_M, without a stop."""
        return self._set_out(tuple(poses), frame, through=True, stop_on_failure=True)

    def followWaypoints(
        self, poses: Sequence[Pose2D], frame: str | None = None, *, stop_on_failure: bool = False
    ) -> bool:
        """Drives to every pose in turn and stops there.

        One that cannot be reached is left out (`missed_waypoints`), or ends the task with `stop_on_failure`. Nav2 differs:
        there a task with missed waypoints has SUCCEEDED.
        """
        return self._set_out(tuple(poses), frame, through=False, stop_on_failure=stop_on_failure)

    def spin(
        self, spin_dist: float = 1.57, time_allowance: float = 10.0, disable_collision_checks: bool = False
    ) -> bool:
        """Turns in place by `spin_dist` (rad, clockwise when negative)."""
        params = SpinParams(
            spin_dist=spin_dist, time_allowance=time_allowance, disable_collision_checks=disable_collision_checks
        )
        return self._behave(Spin("spin", params))

    def backup(
        self,
        backup_dist: float = 0.15,
        backup_speed: float = 0.025,
        time_allowance: float = 10.0,
        disable_collision_checks: bool = False,
    ) -> bool:
        """Reverses by `backup_dist` (m) at `backup_speed` (m/s)."""
        params = BackUpParams(
            backup_dist=backup_dist,
            backup_speed=backup_speed,
            time_allowance=time_allowance,
            disable_collision_checks=disable_collision_checks,
        )
        return self._behave(BackUp("backup", params))

    def driveOnHeading(
        self,
        dist: float = 0.15,
        speed: float = 0.025,
        time_allowance: float = 10.0,
        disable_collision_checks: bool = False,
    ) -> bool:
        """Drives straight by `dist` (m, backwards when it and `speed` are negative)."""
        params = DriveOnHeadingParams(
            dist_to_travel=dist,
            speed=speed,
            time_allowance=time_allowance,
            disable_collision_checks=disable_collision_checks,
        )
        return self._behave(DriveOnHeading("drive_on_heading", params))

    def cancelTask(self) -> None:
        """Ends the task at hand and waits until it has ended: one control cycle."""
        if self._behavior is not None:
            self._end_behavior(TaskResult.CANCELED, GoalCanceledError("the behaviour was cancelled"))
        elif self._handle is not None and not self._handle.is_done:
            self.move_base.cancel_goal(self._handle)
            self._result = TaskResult.CANCELED
            while not self._handle.is_done:
                self._turn(self._now + POLL_S)
            self._error = (self._handle.result.error_code, self._handle.result.message)

    # --- how it stands ------------------------------------------------------------------------------------------------

    def isTaskComplete(self) -> bool:
        """Lets the world go on for POLL_S, or until the task ends; True once it has. Without a task: True."""
        end = self._now + POLL_S
        while self._result is None and self._now < end - EPSILON_S:
            self._turn(end)
        return self._result is not None

    def getFeedback(self) -> TaskFeedback | None:
        """Where the robot stands; None without a task."""
        if self._result is not None:
            return None
        spent = self._now - self._begun
        if self._behavior is not None:
            return TaskFeedback(self.move_base.robot_pose, self._left, spent, None, 0, 0, 0)
        now = self.move_base.feedback
        left = now.distance_remaining
        for a, b in zip(self._poses[self._index :], self._poses[self._index + 1 :]):
            left += a.distance_to(b)
        pace = None
        if now.estimated_time_remaining is not None and now.distance_remaining > 0.0:
            pace = now.estimated_time_remaining / now.distance_remaining
        return TaskFeedback(
            now.pose,
            left,
            spent,
            pace * left if pace is not None else None,
            self._past_recoveries + now.recoveries,
            len(self._poses) - self._index,
            self._index,
        )

    def getResult(self) -> TaskResult:
        """How the last task ended; UNKNOWN while it has not, and before the first."""
        return self._result or TaskResult.UNKNOWN

    def getTaskError(self) -> tuple[int, str]:
        """Code and reason of the last task's failure; (0, "") when there was none."""
        return self._error

    # --- plans and costmaps -------------------------------------------------------------------------------------------

    def getPath(self, start: Pose2D, goal: Pose2D, planner_id: str = "", use_start: bool = False) -> Path | None:
        """A plan without driving, from the robot unless `use_start`; None when there is none (`getTaskError` says why)."""
        if planner_id:
            raise InputError(
                f'there is one global planner, and it has no id "{planner_id}"; MoveBase.reconfigure changes it',
                planner_id=planner_id,
            )
        self._error = NO_ERROR
        try:
            return self.move_base.make_plan(goal, start if use_start else None).path
        except NavError as exc:
            self._error = (exc.code, exc.message)
            return None

    def clearAllCostmaps(self) -> None:
        """Resets every layer of both costmaps."""
        self.move_base.clear_costmaps()

    def clearLocalCostmap(self) -> None:
        """Resets every layer of the local costmap."""
        self.move_base.local_costmap.reset()

    def clearGlobalCostmap(self) -> None:
        """Resets every layer of the global costmap."""
        self.move_base.global_costmap.reset()

    def getGlobalCostmap(self) -> Costmap:
        """The global master grid as it is; copy it to keep it."""
        return self.move_base.global_costmap.master

    def getLocalCostmap(self) -> Costmap:
        """The local master grid as it is; copy it to keep it."""
        return self.move_base.local_costmap.master

    def waitUntilNav2Active(self) -> None:
        """Until both costmaps have been updated once; then plans can be asked for."""
        self._turn(self._now)

    def lifecycleShutdown(self) -> None:
        """Ends every task and stops the robot, for good."""
        self.cancelTask()
        self.move_base.shutdown()

    # --- the works ----------------------------------------------------------------------------------------------------

    def _set_out(self, poses: tuple[Pose2D, ...], frame: str | None, *, through: bool, stop_on_failure: bool) -> bool:
        if not poses:
            raise InputError("there is no pose to go to; give one at least")
        if self._behavior is not None:
            self.cancelTask()
        self._poses, self._frame = poses, frame
        self._through, self._stop_on_failure = through, stop_on_failure
        self._index = 0
        self._past_recoveries = 0
        self.missed_waypoints = []
        self._begin()
        self._handle = self.move_base.send_goal(poses[0], frame)
        return True

    def _begin(self) -> None:
        self._begun = self._now
        self._result = None
        self._error = NO_ERROR

    def _turn(self, end: float) -> None:
        """The world goes on to what is due next, `end` (s) at the latest; then whatever is due is done."""
        due = min(end, self.move_base.next_due(self._now))
        if self._behavior is not None:
            due = min(due, self._next_step)
        self._now = self._advance(due)
        self.move_base.tick(self._now)
        if self._behavior is not None:
            if self._now >= self._next_step - EPSILON_S:
                self._step(self._behavior)
        elif self._result is None:
            self._look()

    def _look(self) -> None:
        """On to the next pose where one is done with."""
        handle = self._handle
        assert handle is not None
        last = self._index + 1 == len(self._poses)
        if not handle.is_done:
            if self._through and not last and self._has_passed(handle):
                self._past_recoveries += self.move_base.feedback.recoveries
                self._next_pose()
            return
        result = handle.result
        if handle.status is GoalStatus.PREEMPTED or handle.status is GoalStatus.RECALLED:
            self._result = TaskResult.CANCELED
            self._error = (result.error_code, result.message or handle.text)
            return
        self._past_recoveries += result.recoveries
        if handle.status is not GoalStatus.SUCCEEDED:
            self.missed_waypoints.append(self._index)
            self._error = (result.error_code, result.message or handle.text)
            if self._through or self._stop_on_failure:
                self._result = TaskResult.FAILED
                return
        if last:
            self._result = TaskResult.FAILED if self.missed_waypoints else TaskResult.SUCCEEDED
        else:
            self._next_pose()

    def _has_passed(self, handle: GoalHandle) -> bool:
        move_base = self.move_base
        robot, goal = move_base.robot_pose, move_base.goal_pose
        if move_base.goal_handle is not handle or robot is None or goal is None:
            return False
        return robot.distance_to(goal) <= PASSED_RADIUS_M

    def _next_pose(self) -> None:
        self._index += 1
        self._handle = self.move_base.send_goal(self._poses[self._index], self._frame)

    def _behave(self, behavior: RecoveryBehavior) -> bool:
        self.cancelTask()
        self._poses, self._handle = (), None
        context = self.move_base.recovery_context
        behavior.check(context)
        # the costmap as it is now, not as it was when the last task ended
        self._turn(self._now)
        self._begin()
        behavior.start(context, self._now)
        self._behavior = behavior
        self._next_step = self._now
        return True

    def _step(self, behavior: RecoveryBehavior) -> None:
        move_base, now = self.move_base, self._now
        self._next_step = now + 1.0 / (behavior.frequency or move_base.params.controller_frequency)
        try:
            if not move_base.local_costmap.is_current(now):
                raise StaleSensorsError(f"a sensor of {move_base.local_costmap.name} is silent: not moving without it")
            step = behavior.step(move_base.local_state(now), now)
        except NavError as exc:
            self._end_behavior(TaskResult.FAILED, exc)
            return
        except Exception as exc:
            said = f"{type(exc).__name__}: {exc}"
            self._end_behavior(TaskResult.FAILED, InternalError(f"{behavior.name} raised {said}; please report this"))
            return
        self._left = float(step.data.get("left_m", step.data.get("left_rad", 0.0)))
        if step.status is RecoveryStatus.RUNNING:
            move_base.robot.command(step.twist)
        elif step.status is RecoveryStatus.DONE:
            self._end_behavior(TaskResult.SUCCEEDED, None)
        else:
            self._end_behavior(TaskResult.FAILED, NavError(step.text or f"{behavior.name} failed"))

    def _end_behavior(self, result: TaskResult, error: NavError | None) -> None:
        self._behavior = None
        self._result = result
        self._error = NO_ERROR if error is None else (error.code, error.message)
        self.move_base.robot.command(Twist2D())
