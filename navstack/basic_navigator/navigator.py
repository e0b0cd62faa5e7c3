"""`BasicNavigator`: names and semantics of nav2_simple_commander (robot_navigator.py)."""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Callable, Sequence

import numpy as np

from navstack.basic_navigator.task import NO_ERROR, PASSED_RADIUS_M, POLL_S, TaskFeedback, TaskResult
from navstack.bringup import build_move_base, simulated_robot
from navstack.core import Costmap, Listener, OccupancyGrid, Path, Pose2D, Twist2D
from navstack.core.errors import InputError, NavError
from navstack.costmap import LayeredCostmap
from navstack.interfaces import RecoveryBehavior, RecoveryStatus
from navstack.map_io import load_map
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


class BasicNavigator:
    """Executes one task at a time: a pose, poses to drive through, waypoints to stop at, or a behavior (spin, backup).

        navigator.goToPose(goal)
        while not navigator.isTaskComplete():
            print(navigator.getFeedback())
        print(navigator.getResult())

    Every `isTaskComplete` advances the robot and the goal manager by `POLL_S`; nothing moves in between.
    """

    def __init__(self, move_base: MoveBase, advance: Callable[[float], float]) -> None:
        """Create a navigator. `advance(t)` runs the robot until `t` (s) and returns the time.

        In a simulation that is `advance_to`; for a real robot it sleeps. It returns at once if `t` is in the past.
        """
        self.move_base = move_base
        self.missed_waypoints: list[int] = []
        """Indices of the waypoints that the last followWaypoints did not reach."""
        self._advance = advance
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
        robot = simulated_robot(configuration, static_map, start, obstacles=obstacles, seed=seed)
        move_base = build_move_base(configuration, robot, static_map=static_map, listeners=listeners)

        def advance(until: float) -> float:
            if until > robot.time:
                robot.advance_to(until)
            return robot.time

        return cls(move_base, advance)

    # --- tasks --------------------------------------------------------------------------------------------------------

    def goToPose(self, pose: Pose2D, frame: str | None = None) -> bool:
        """Drive to `pose` (default frame: the global costmap's) and end the previous task. Returns True: accepted."""
        return self._drive_to((pose,), frame, through=False, stop_on_failure=True)

    def goThroughPoses(self, poses: Sequence[Pose2D], frame: str | None = None) -> bool:
        """Drive to the last pose through the others, which the robot passes within PASSED_RADIUS_M without a stop."""
        return self._drive_to(tuple(poses), frame, through=True, stop_on_failure=True)

    def followWaypoints(
        self, poses: Sequence[Pose2D], frame: str | None = None, *, stop_on_failure: bool = False
    ) -> bool:
        """Drive to every pose in order and stop there.

        A waypoint that cannot be reached is skipped (`missed_waypoints`), or ends the task with `stop_on_failure`. Nav2
        differs: there a task with missed waypoints has SUCCEEDED.
        """
        return self._drive_to(tuple(poses), frame, through=False, stop_on_failure=stop_on_failure)

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
            return TaskFeedback(self.move_base.robot_pose, self._remaining, spent, None, 0, 0, 0)
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

    def getTaskError(self) -> tuple[int, str]:
        """Return code and reason of the last task's failure; (0, "") without a failure."""
        return self._error

    # --- plans and costmaps -------------------------------------------------------------------------------------------

    def getPath(self, start: Pose2D, goal: Pose2D, planner_id: str = "", use_start: bool = False) -> Path | None:
        """Plan without driving, from the robot unless `use_start`; None without a plan, with the reason in `getTaskError`."""
        if planner_id:
            raise InputError(
                f'planner_id "{planner_id}" is not supported: there is one global planner, which MoveBase.reconfigure changes',
                planner_id=planner_id,
            )
        self._error = NO_ERROR
        try:
            return self.move_base.make_plan(goal, start if use_start else None).path
        except NavError as exc:
            self._error = (exc.code, exc.message)
            return None

    def getPathThroughPoses(
        self, start: Pose2D, goals: Sequence[Pose2D], planner_id: str = "", use_start: bool = False
    ) -> Path | None:
        """Plan through all `goals` in order; None if a leg has no plan, with the reason in `getTaskError`."""
        if not goals:
            raise InputError("the list of goals is empty; give at least one")
        legs = [self.getPath(start, goals[0], planner_id, use_start)]
        for a, b in itertools.pairwise(goals):
            if legs[-1] is None:
                break
            legs.append(self.getPath(a, b, planner_id, True))
        found = [leg.poses for leg in legs if leg is not None]
        return Path(np.concatenate(found)) if len(found) == len(legs) else None

    def changeMap(self, map_filepath: str | os.PathLike[str] | OccupancyGrid) -> bool:
        """Replace the static map of both costmaps; False if no layer accepts it. Raises MapError for an unreadable file."""
        grid = map_filepath if isinstance(map_filepath, OccupancyGrid) else load_map(os.fspath(map_filepath))
        costmaps = (self.move_base.global_costmap, self.move_base.local_costmap)
        taken = [isinstance(c, LayeredCostmap) and c.set_static_map(grid) for c in costmaps]
        self.move_base.costmaps_changed()
        return any(taken)

    def setInitialPose(self, initial_pose: Pose2D) -> None:
        """Confirm where the robot is (global frame). Raises InputError if the localization places it elsewhere.

        Nav2 differs: there the pose initializes amcl. The localization of a simulated robot is initialized by its start.
        """
        self.waitUntilNav2Active()
        away = self.move_base.global_costmap.robot_pose(self._now).distance_to(initial_pose)
        if away > PASSED_RADIUS_M:
            raise InputError(
                f"the initial pose ({initial_pose.x:g}, {initial_pose.y:g}) is {away:.2f} m from where the robot is localized; "
                "give it as `start` to BasicNavigator.simulated, or initialize the localization of your robot",
                distance_m=away,
            )

    def clearAllCostmaps(self) -> None:
        """Reset every layer of both costmaps."""
        self.move_base.clear_costmaps()

    def clearLocalCostmap(self) -> None:
        """Reset every layer of the local costmap."""
        self.move_base.local_costmap.reset()

    def clearGlobalCostmap(self) -> None:
        """Reset every layer of the global costmap."""
        self.move_base.global_costmap.reset()

    def getGlobalCostmap(self) -> Costmap:
        """Return the global master grid, which later updates change; copy it to keep it."""
        return self.move_base.global_costmap.master

    def getLocalCostmap(self) -> Costmap:
        """Return the local master grid, which later updates change; copy it to keep it."""
        return self.move_base.local_costmap.master

    def waitUntilNav2Active(self, navigator: str = "bt_navigator", localizer: str = "amcl") -> None:
        """Update both costmaps once, so that plans can be requested. The names of Nav2's nodes have no effect."""
        del navigator, localizer
        self._tick(self._now)

    def lifecycleStartup(self) -> None:
        """Do nothing: every part is active from the start."""

    def lifecycleShutdown(self) -> None:
        """End every task, stop the robot and reject later tasks."""
        self.cancelTask()
        self.move_base.shutdown()

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
        self._start_task()
        frequency = plugin_calls.start_recovery(behavior, context, self._now)
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
