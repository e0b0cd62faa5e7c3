"""`BasicNavigator`: names and semantics of nav2_simple_commander (robot_navigator.py)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from navstack.basic_navigator.follow_path import FollowPath
from navstack.basic_navigator.services import NavigatorServices, not_supported
from navstack.basic_navigator.task import NO_ERROR, PASSED_RADIUS_M, POLL_S, TaskFeedback, TaskResult
from navstack.bringup import build_move_base, simulated_robot
from navstack.core import Listener, OccupancyGrid, Path, Pose2D, Twist2D
from navstack.core.errors import InputError, NavError
from navstack.interfaces import RecoveryBehavior, RecoveryStatus
from navstack.move_base import GoalHandle, GoalStatus, MoveBase, plugin_calls
from navstack.move_base.errors import GoalCanceledError, StaleSensorsError
from navstack.move_base.schedule import EPSILON_S
from navstack.parameters.configuration import Configuration
from navstack.recovery import (
    BackUp,
    BackUpParams,
    DriveOnHeading,
    DriveOnHeadingParams,
    Spin,
    SpinParams,
)


class BasicNavigator(NavigatorServices):
    """Executes one task at a time: a pose, poses to drive through, waypoints to stop at, a path, or a behavior (spin, backup).

        navigator.goToPose(goal)
        while not navigator.isTaskComplete():
            print(navigator.getFeedback())
        print(navigator.getResult())

    Every `isTaskComplete` advances the robot and the goal manager by `POLL_S`; nothing moves in between.
    """

    def __init__(
        self,
        move_base: MoveBase,
        advance: Callable[[float], float],
        *,
        place: Callable[[Pose2D], None] | None = None,
    ) -> None:
        """Create a navigator. `advance(t)` runs the robot until `t` (s) and returns the time.

        In a simulation that is `advance_to`; for a real robot it sleeps. It returns at once if `t` is in the past.
        `place` initializes the robot's localization with a pose (global frame), for `setInitialPose`.
        """
        self.move_base = move_base
        self.missed_waypoints: list[int] = []
        """Indices of the waypoints that the last followWaypoints did not reach."""
        self._advance = advance
        self._place = place
        self._now = advance(0.0)
        self._started_at = self._now
        self._poses: tuple[Pose2D, ...] = ()
        self._frame: str | None = None
        self._index = 0
        self._through = False
        self._stop_on_failure = True
        self._handle: GoalHandle | None = None
        self._past_recoveries = 0
        self._behavior: RecoveryBehavior | None = None
        self._next_step = 0.0
        self._frequency = math.inf
        self._remaining = 0.0
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
        """Create a navigator of a simulated robot at `start`. Raises as `navstack.simulated_robot` does."""

        def built(at: Pose2D) -> tuple[MoveBase, Callable[[float], float]]:
            robot = simulated_robot(configuration, static_map, at, obstacles=obstacles, seed=seed)

            def advance(until: float) -> float:
                if until > robot.time:
                    robot.advance_to(until)
                return robot.time

            return build_move_base(configuration, robot, static_map=static_map, listeners=listeners), advance

        navigator = cls(*built(start))

        def place(pose: Pose2D) -> None:
            if navigator._now > 0.0:
                navigator._place = None
                navigator.setInitialPose(pose)
            elif pose != navigator.move_base.global_costmap.robot_pose():
                navigator.move_base, navigator._advance = built(pose)

        navigator._place = place
        return navigator

    # --- tasks --------------------------------------------------------------------------------------------------------

    def goToPose(self, pose: Pose2D, frame: str | None = None, behavior_tree: str = "") -> bool:
        """Drive to `pose` (default frame: the global costmap's) and end the previous task. Returns True: accepted."""
        _check_tree(behavior_tree)
        return self._drive_to((pose,), frame, through=False, stop_on_failure=True)

    def goThroughPoses(self, poses: Sequence[Pose2D], frame: str | None = None, behavior_tree: str = "") -> bool:
        """Drive to the last pose through the others, which the robot passes within PASSED_RADIUS_M without a stop."""
        _check_tree(behavior_tree)
        return self._drive_to(tuple(poses), frame, through=True, stop_on_failure=True)

    def followWaypoints(
        self, poses: Sequence[Pose2D], frame: str | None = None, *, stop_on_failure: bool = False
    ) -> bool:
        """Drive to every pose in order and stop there.

        A waypoint that cannot be reached is skipped (`missed_waypoints`), or ends the task with `stop_on_failure`. Nav2
        differs: there a task with missed waypoints has SUCCEEDED.
        """
        return self._drive_to(tuple(poses), frame, through=False, stop_on_failure=stop_on_failure)

    def followPath(self, path: Path, controller_id: str = "", goal_checker_id: str = "") -> bool:
        """Follow `path` with the local planner, without the global planner and without recoveries, to its last pose.

        Fails after `controller_patience` without a command and after `oscillation_timeout` without progress. Raises
        InvalidPathError for a path that is empty or not finite.
        """
        if controller_id or goal_checker_id:
            not_supported(
                "controller_id or goal_checker_id",
                "there is one local planner with one goal checker; choose it with base_local_planner",
            )
        return self._run_behavior(FollowPath(self.move_base, path))

    def spin(
        self, spin_dist: float = 1.57, time_allowance: float = 10.0, disable_collision_checks: bool = False
    ) -> bool:
        """Turn in place by `spin_dist` (rad, clockwise if negative)."""
        params = SpinParams(
            spin_dist=spin_dist, time_allowance=time_allowance, disable_collision_checks=disable_collision_checks
        )
        return self._run_behavior(Spin("spin", params))

    def backup(
        self,
        backup_dist: float = 0.15,
        backup_speed: float = 0.025,
        time_allowance: float = 10.0,
        disable_collision_checks: bool = False,
    ) -> bool:
        """Reverse by `backup_dist` (m) at `backup_speed` (m/s)."""
        params = BackUpParams(
            backup_dist=backup_dist,
            backup_speed=backup_speed,
            time_allowance=time_allowance,
            disable_collision_checks=disable_collision_checks,
        )
        return self._run_behavior(BackUp("backup", params))

    def driveOnHeading(
        self,
        dist: float = 0.15,
        speed: float = 0.025,
        time_allowance: float = 10.0,
        disable_collision_checks: bool = False,
    ) -> bool:
        """Drive straight by `dist` (m, backwards if it and `speed` are negative)."""
        params = DriveOnHeadingParams(
            dist_to_travel=dist,
            speed=speed,
            time_allowance=time_allowance,
            disable_collision_checks=disable_collision_checks,
        )
        return self._run_behavior(DriveOnHeading("drive_on_heading", params))

    def cancelTask(self) -> None:
        """Cancel the present task and wait for its end, at most one control cycle."""
        if self._behavior is not None:
            self._end_behavior(TaskResult.CANCELED, GoalCanceledError("the behavior was cancelled"))
        elif self._handle is not None and not self._handle.is_done:
            self.move_base.cancel_goal(self._handle)
            self._result = TaskResult.CANCELED
            while not self._handle.is_done:
                self._tick(self._now + POLL_S)
            self._error = (self._handle.result.error_code, self._handle.result.message)

    # --- progress -----------------------------------------------------------------------------------------------------

    def isTaskComplete(self) -> bool:
        """Advance by POLL_S or until the task ends; return True after its end, and without a task."""
        end = self._now + POLL_S
        while self._result is None and self._now < end - EPSILON_S:
            self._tick(end)
        return self._result is not None

    def getFeedback(self) -> TaskFeedback | None:
        """Return the progress; None without a task."""
        if self._result is not None:
            return None
        spent = self._now - self._started_at
        if self._behavior is not None:
            return TaskFeedback(self._robot_pose(), self._remaining, spent, None, 0, 0, 0)
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
        """Return the result of the last task; UNKNOWN before its end and before the first task."""
        return self._result or TaskResult.UNKNOWN

    # --- execution ----------------------------------------------------------------------------------------------------

    def _drive_to(self, poses: tuple[Pose2D, ...], frame: str | None, *, through: bool, stop_on_failure: bool) -> bool:
        if not poses:
            raise InputError("the list of poses is empty; give at least one")
        if self._behavior is not None:
            self.cancelTask()
        self._poses, self._frame = poses, frame
        self._through, self._stop_on_failure = through, stop_on_failure
        self._index = 0
        self._past_recoveries = 0
        self.missed_waypoints = []
        self._start_task()
        self._handle = self.move_base.send_goal(poses[0], frame)
        return True

    def _robot_pose(self) -> Pose2D | None:
        try:
            return plugin_calls.robot_pose(self.move_base.global_costmap, self._now)
        except NavError:
            return None

    def _start_task(self) -> None:
        self._started_at = self._now
        self._result = None
        self._error = NO_ERROR

    def _tick(self, end: float) -> None:
        """Advance to the next due time, at most to `end` (s), and execute what is due."""
        due = min(end, self.move_base.next_due(self._now))
        if self._behavior is not None:
            due = min(due, self._next_step)
        self._now = self._advance(due)
        self.move_base.tick(self._now)
        if self._behavior is not None:
            if self._now >= self._next_step - EPSILON_S:
                self._step(self._behavior)
        elif self._result is None:
            self._check_goal()

    def _check_goal(self) -> None:
        """Send the next pose once the robot has reached or passed the present one."""
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

    def _run_behavior(self, behavior: RecoveryBehavior) -> bool:
        self.cancelTask()
        self._poses, self._handle = (), None
        context = self.move_base.recovery_context
        plugin_calls.call(behavior, behavior.check, context)
        # update the costmaps, which may be as old as the last task
        self._tick(self._now)
        frequency = plugin_calls.start_recovery(behavior, context, self._now)
        self._start_task()
        self._frequency = frequency or context.controller_frequency
        self._behavior = behavior
        self._next_step = self._now
        return True

    def _step(self, behavior: RecoveryBehavior) -> None:
        move_base, now = self.move_base, self._now
        self._next_step = now + 1.0 / self._frequency
        try:
            if not plugin_calls.is_current(move_base.local_costmap, now):
                raise StaleSensorsError(f"a sensor of {move_base.local_costmap.name} is stale: the robot must not move")
            step = plugin_calls.recovery_step(behavior, move_base.local_state(now), now)
        except NavError as exc:
            self._end_behavior(TaskResult.FAILED, exc)
            return
        self._remaining = float(step.data.get("left_m", step.data.get("left_rad", 0.0)))
        if step.status is RecoveryStatus.RUNNING:
            plugin_calls.send_command(move_base.robot, step.twist)
        elif step.status is RecoveryStatus.DONE:
            self._end_behavior(TaskResult.SUCCEEDED, None)
        else:
            self._end_behavior(TaskResult.FAILED, NavError(step.text or f"{behavior.name} failed"))

    def _end_behavior(self, result: TaskResult, error: NavError | None) -> None:
        self._behavior = None
        self._result = result
        self._error = NO_ERROR if error is None else (error.code, error.message)
        plugin_calls.send_command(self.move_base.robot, Twist2D())


def _check_tree(behavior_tree: str) -> None:
    if behavior_tree:
        not_supported("behavior_tree", "list the recovery behaviors in recovery_behaviors of move_base")
