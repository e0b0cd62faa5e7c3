"""The goal manager: takes goals, keeps the costmaps fresh, plans, drives, recovers, and ends every goal with a reason.

Source: move_base/src/move_base.cpp. One turn of the crank is `MoveBase.tick(now)`: sense, update the costmaps that are due,
drive or recover, plan. A plan is taken up by the control cycle after the one that asked for it, as in C++, where it
comes from another thread a few milliseconds later. Nothing here sleeps, starts a thread or reads a clock.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from navstack.core import Event, Listener, Path, Pose2D, RobotState, Twist2D
from navstack.core.errors import InputError, InternalError, NavError, PlanningTimeoutError
from navstack.core.frames import clean_frame
from navstack.core.poses import require_pose
from navstack.interfaces import (
    ControlInput,
    CostmapServer,
    GlobalPlanner,
    LocalPlan,
    LocalPlanner,
    Plan,
    RecoveryBehavior,
    RecoveryContext,
    RecoveryStatus,
    Robot,
)
from navstack.move_base import plugin_calls, status_messages
from navstack.move_base.action_server import SimpleActionServer
from navstack.move_base.active_goal import ActiveGoal, check_goal
from navstack.move_base.costmap_updater import CostmapUpdater, describe
from navstack.move_base.errors import (
    BusyError,
    GoalReplacedError,
    GoalTimeLimitError,
    NoProgressError,
    StaleSensorsError,
)
from navstack.move_base.feedback import Feedback, distance_remaining
from navstack.move_base.goal import Goal, GoalHandle, Quaternion, yaw_of
from navstack.move_base.goal_status import GoalStatus
from navstack.move_base.make_plan import make_plan
from navstack.move_base.occupied_cell import add_layer
from navstack.move_base.plan_schedule import PlanSchedule
from navstack.move_base.planning import InlinePlanning, PlanAnswer, Planning, PlanRequest
from navstack.move_base.progress import Progress, ProgressChecker
from navstack.move_base.recovery_runner import Ended, RecoveryRunner
from navstack.move_base.schedule import EPSILON_S, Schedule
from navstack.move_base.speed_limiter import SpeedLimiter
from navstack.move_base.state_machine import Action, Mode, NavEvent, NavState, Outcome, Transition, Trigger, step
from navstack.move_base.tick_result import TickResult
from navstack.parameters.models.move_base import MoveBaseParams

STANDING = Twist2D()
MAX_RECOVERY_ROUNDS = 3
"""How often the list of recoveries is run through without the robot getting anywhere, whatever resets the index."""


class MoveBase:
    """Drives a robot to one goal at a time. See the module for how a tick goes."""

    def __init__(
        self,
        params: MoveBaseParams,
        *,
        robot: Robot,
        global_costmap: CostmapServer,
        local_costmap: CostmapServer,
        global_planner: GlobalPlanner,
        local_planner: LocalPlanner,
        recoveries: Sequence[RecoveryBehavior] = (),
        listeners: Sequence[Listener] = (),
        planning: Planning | None = None,
        global_update_frequency: float | None = None,
        local_update_frequency: float | None = None,
        recovery_time_limit_s: float = 120.0,
        goal_time_limit_s: float = math.inf,
    ) -> None:
        """`planning` says how long planning takes (none at all when None). The update frequencies (Hz) are those of the
        costmaps' own parameters unless given. A recovery that runs longer than `recovery_time_limit_s` has failed.

        A goal that is not reached within `goal_time_limit_s` after it was accepted is aborted. C++ has no such limit, and
        by default there is none: with oscillation_timeout 0 a goal may then be driven to for ever.

        Raises a ParameterError when a recovery's parameters do not fit the costmaps.
        """
        self.params = params
        self.robot = robot
        self.global_costmap = global_costmap
        self.local_costmap = local_costmap
        self.global_planner = global_planner
        self.local_planner = local_planner
        self.recoveries = tuple(recoveries)
        self.listeners: list[Listener] = list(listeners)
        self.server = SimpleActionServer(self._on_status)
        self.goal_time_limit_s = goal_time_limit_s
        """s from acceptance, for goals that come without a limit of their own; inf for none."""
        self.last_tick = TickResult(0.0)
        """What the last tick did."""
        self._state = NavState()
        self._now = 0.0
        self._ticked = False
        self._goal_count = 0
        self._shut_down = False
        self._control = Schedule(params.controller_frequency)
        self._costmap_updater = CostmapUpdater(
            robot,
            global_costmap,
            local_costmap,
            self._warn,
            global_update_frequency=global_update_frequency,
            local_update_frequency=local_update_frequency,
            on=not params.shutdown_costmaps,
        )
        self._planning: Planning = planning or InlinePlanning()
        self._plan_schedule = PlanSchedule(params)
        # the goal at hand
        self._active_goal: ActiveGoal | None = None
        self._goal_frame = ""
        self._plan: Plan | None = None
        self._new_plan: Plan | None = None
        self._local_plan: LocalPlan | None = None
        self._last_valid_control = 0.0
        self._last_progress = 0.0
        self._stale_since: float | None = None
        self._progress = ProgressChecker(params.oscillation_distance)
        self._pose: Pose2D | None = None
        self._speed_limiter = SpeedLimiter((local_costmap, global_costmap), local_planner)
        # commands
        self._command = STANDING
        self._command_time = -math.inf
        self._driver_error: NavError | None = None
        # recovery
        self._context = RecoveryContext(global_costmap, local_costmap, local_planner, params.controller_frequency)
        self._recovery = RecoveryRunner(self._tell_recovery, params.controller_frequency, recovery_time_limit_s)
        self._followed: list[RecoveryBehavior] = []
        for recovery in self.recoveries:
            recovery.check(self._context)

    # --- what others may look at --------------------------------------------------------------------------------------

    @property
    def now(self) -> float:
        """Time of the last tick, s."""
        return self._now

    @property
    def state(self) -> Mode:
        """IDLE, PLANNING, CONTROLLING or CLEARING."""
        return self._state.mode

    @property
    def trigger(self) -> Trigger:
        """What the last recovery was for."""
        return self._state.trigger

    @property
    def recovery_index(self) -> int:
        """Which recovery is next, or runs."""
        return self._state.recovery_index

    @property
    def recovery(self) -> str | None:
        """The name of the recovery behaviour that runs."""
        running = self._recovery.running
        return running.name if running is not None else None

    @property
    def recovery_context(self) -> RecoveryContext:
        """What a recovery behaviour may act on, for those who run one themselves while there is no goal."""
        return self._context

    @property
    def goal_handle(self) -> GoalHandle | None:
        """The goal being worked on."""
        return self._active_goal.handle if self._active_goal is not None else None

    @property
    def goal_pose(self) -> Pose2D | None:
        """That goal in the global costmap's frame."""
        return self._active_goal.pose if self._active_goal is not None else None

    @property
    def plan(self) -> Plan | None:
        """The global planner's last plan for the goal at hand."""
        return self._plan

    @property
    def path(self) -> Path | None:
        """That plan's path."""
        return self._plan.path if self._plan is not None else None

    @property
    def local_plan(self) -> LocalPlan | None:
        """The local planner's last word for the goal at hand."""
        return self._local_plan

    @property
    def command(self) -> Twist2D:
        """The last velocity commanded."""
        return self._command

    @property
    def robot_pose(self) -> Pose2D | None:
        """The robot in the global costmap's frame at the last control cycle; None when it was not known."""
        return self._pose

    @property
    def feedback(self) -> Feedback:
        """Where the robot stands with its goal; computed when asked."""
        active = self._active_goal
        if active is None:
            return Feedback(self._pose, self._state.mode, 0.0, 0.0, None, 0)
        spent = active.age(self._now)
        left = distance_remaining(self._pose, self.path, active.pose)
        speed = active.driven_m / spent if spent > 0.0 else 0.0
        return Feedback(
            self._pose,
            self._state.mode,
            left,
            spent,
            left / speed if speed > 0.01 else None,
            len(active.statistics.recoveries),
        )

    def local_state(self, now: float) -> RobotState:
        """Pose in the local costmap's frame at `now` (s), velocity as the robot says; raises NavError."""
        return self._costmap_updater.local_state(now)

    # --- goals --------------------------------------------------------------------------------------------------------

    def send_goal(
        self,
        pose: Pose2D,
        frame: str | None = None,
        *,
        orientation: Quaternion | None = None,
        goal_id: str | None = None,
        stamp: float | None = None,
        time_limit_s: float | None = None,
    ) -> GoalHandle:
        """Asks for `pose` (m, rad) in `frame` (the global costmap's when None); any goal before it is replaced.

        With `orientation` (x, y, z, w) the heading is that quaternion's. `stamp` (s) is the time of the last tick unless
        given; goals stamped before the one at hand are RECALLED. What is wrong with a goal shows in the handle, which
        reaches a terminal state in any case. `time_limit_s` counts from acceptance; `goal_time_limit_s` when None.
        Raises InputError for what is no Pose2D.
        """
        pose = require_pose(pose, "goal")
        self._goal_count += 1
        if orientation is not None:
            yaw = yaw_of(orientation) if all(math.isfinite(c) for c in orientation) else math.nan
            pose = Pose2D(pose.x, pose.y, yaw)
        stamp = self._now if stamp is None else stamp
        if not math.isfinite(stamp):
            raise InputError(f"a goal's stamp is a time in seconds, not {stamp}", stamp=stamp)
        if time_limit_s is not None and not time_limit_s > 0.0:
            raise InputError(f"a goal's time limit is a positive time in seconds, not {time_limit_s}; None for none")
        name = goal_id or f"goal-{self._goal_count}"
        goal = Goal(pose, clean_frame(frame or self.global_costmap.frame), name, stamp, orientation, time_limit_s)
        return self.server.submit(goal, self._now)

    def cancel_goal(self, goal: GoalHandle | str) -> None:
        """Asks to end a goal, by its handle or id; it ends within one control cycle."""
        self.server.cancel(self._now, goal if isinstance(goal, str) else goal.id)

    def cancel_all_goals(self) -> None:
        """Asks to end every goal."""
        self.server.cancel(self._now)

    def cancel_goals_at_and_before(self, stamp: float) -> None:
        """Asks to end every goal stamped up to `stamp` (s), also those that are yet to come."""
        self.server.cancel(self._now, None, stamp)

    # --- run-time changes ---------------------------------------------------------------------------------------------

    def reconfigure(
        self,
        params: MoveBaseParams | None = None,
        *,
        global_planner: GlobalPlanner | None = None,
        local_planner: LocalPlanner | None = None,
    ) -> None:
        """Changes parameters and planner plugins while running, as move_base's dynamic_reconfigure does.

        New planners drop every plan; a goal at hand goes on, from PLANNING, with the robot stopped and all patience new.
        Parameters hold from the next cycle on. Everything or nothing: whatever raises, the old ones stay.

        Recoveries and costmaps stay; `navstack.bringup.reconfigure` makes the planners from a
        configuration. Raises InputError for what is no planner, a ParameterError when a recovery does not fit.
        """
        plugin_calls.check_plugin(global_planner, GlobalPlanner)
        plugin_calls.check_plugin(local_planner, LocalPlanner)
        params = params or self.params
        driver = local_planner or self.local_planner
        context = RecoveryContext(self.global_costmap, self.local_costmap, driver, params.controller_frequency)
        for recovery in self.recoveries:
            recovery.check(context)
        masks = (
            SpeedLimiter((self.local_costmap, self.global_costmap), driver) if local_planner else self._speed_limiter
        )
        # nothing can fail from here on
        now = self._now
        self._context = context
        self._set_params(params, now)
        if global_planner is None and local_planner is None:
            return
        self.global_planner = global_planner or self.global_planner
        if local_planner is not None:
            self.local_planner = local_planner
            self._speed_limiter = masks
            self._followed.clear()  # limits that recoveries set were those of the old one
        self._planning.abandon()
        self._plan = self._new_plan = self._local_plan = None
        names = f"{type(self.global_planner).__name__}, {type(self.local_planner).__name__}"
        self._emit(now, "info", f"planners changed: {names}", {})
        self._apply(NavEvent.PLANNERS_CHANGED, now)

    def costmaps_changed(self) -> None:
        """Whoever gave a costmap other parameters while running says so: update frequencies, the recoveries' limits."""
        self._costmap_updater.read_frequencies(self._now)
        self._emit(self._now, "info", "costmaps changed", {})

    def _set_params(self, params: MoveBaseParams, now: float) -> None:
        before, self.params = self.params, params
        if params.controller_frequency != before.controller_frequency:
            self._control = Schedule(params.controller_frequency, now)
            self._recovery.set_frequency(params.controller_frequency, now)
        self._plan_schedule.set_params(params, now, may_plan=self._state.mode in (Mode.PLANNING, Mode.CONTROLLING))
        if params.oscillation_distance != before.oscillation_distance:
            self._progress = ProgressChecker(params.oscillation_distance)
        if params.shutdown_costmaps != before.shutdown_costmaps:
            self._costmap_updater.switch(self._has_goal() or not params.shutdown_costmaps, now)

    # --- the crank ----------------------------------------------------------------------------------------------------

    def next_due(self, now: float) -> float:
        """When `tick` has something to do next (s), `now` at the earliest; inf for never."""
        if not self._ticked or (self._state.mode is Mode.IDLE and self.server.is_new_goal_available):
            return now
        due = self._costmap_updater.due
        mode = self._state.mode
        if mode is not Mode.IDLE:
            due = min(
                due, self._control.due if self._recovery.running is None else self._recovery.due, self._planning.due
            )
            if not self._planning.is_busy and mode is not Mode.CLEARING:
                due = min(due, self._plan_schedule.due)
        return max(now, due)

    def tick(self, now: float) -> None:
        """One turn of the crank at `now` (s). Call it at `next_due`; more often does no harm.

        Raises InputError when time runs backwards. Failures of plugins, costmaps and the robot end in the goal's result.
        """
        if not now >= self._now - EPSILON_S or not math.isfinite(now):
            raise InputError(f"time runs forwards: tick({now}) after tick({self._now})", now=now, last=self._now)
        now = max(now, self._now)
        if not self._ticked:
            self._ticked = True
            self._costmap_updater.restart(now)
        self._now = now
        turn = self.last_tick = TickResult(now)
        self._costmap_updater.observe(now, turn)
        if self._state.mode is Mode.IDLE and self.server.is_new_goal_available:
            self._begin(now)
        self._costmap_updater.update(now, turn)
        if self._state.mode is Mode.IDLE:
            return
        answer = self._planning.poll(now)
        if answer is not None:
            self._hear(answer, now)
        if self._recovery.running is not None:
            self._recover(self._recovery.running, now)
        if self._recovery.running is None and self._control.is_due(now) and self._has_goal():
            self._cycle(now)
        if self._has_goal():
            self._ask_planner(now)
        if self._driver_error is not None and self._has_goal():
            self._end_with(NavEvent.DRIVER_FAILED, self._driver_error, now)

    def shutdown(self) -> None:
        """Ends every goal ("node has been killed") and stops the robot; goals that come later end at once."""
        self._shut_down = True
        self._apply(NavEvent.SHUTDOWN, self._now)
        while self.server.is_new_goal_available:
            self._begin(self._now)

    def _has_goal(self) -> bool:
        return self._state.mode is not Mode.IDLE

    # --- goals begin --------------------------------------------------------------------------------------------------

    def _begin(self, now: float) -> None:
        """Takes the waiting goal, when there is none at hand."""
        active = self._accept(now)
        if self._shut_down:
            self._apply(NavEvent.GOAL_ACCEPTED, now)
            self._apply(NavEvent.SHUTDOWN, now)
        elif active.error is not None:
            self._apply(NavEvent.GOAL_INVALID, now)
        else:
            self._control.restart(now)
            self._driver_error = None
            self._costmap_updater.retry_failed(now)
            self._apply(NavEvent.GOAL_ACCEPTED, now)

    def _accept(self, now: float) -> ActiveGoal:
        handle = self.server.accept(now)
        goal = handle.goal
        limit = self.goal_time_limit_s if goal.time_limit_s is None else goal.time_limit_s
        active = self._active_goal = ActiveGoal(handle, now + limit)
        self._plan = self._new_plan = self._local_plan = None
        self._stale_since = None
        self._planning.abandon()
        self._progress.reset()
        self._emit(
            now,
            "goal",
            f'goal {goal.id}: ({goal.pose.x:.3f}, {goal.pose.y:.3f}, {goal.pose.yaw:.3f}) in "{goal.frame}"',
            {"id": goal.id, "pose": list(goal.pose), "frame": goal.frame, "stamp": goal.stamp},
        )
        active.error = check_goal(goal)
        if active.error is None:
            self._goal_frame = self.global_costmap.frame
            self._locate_goal(active, now)
        return active

    def _locate_goal(self, active: ActiveGoal, now: float) -> NavError | None:
        """Brings the goal into the global costmap's frame; the error when that cannot be done (yet)."""
        goal = active.handle.goal
        target = self.global_costmap.frame
        try:
            active.pose = self.robot.frames.lookup(target, goal.frame).apply(goal.pose)
        except NavError as exc:
            return exc
        except Exception as exc:
            return plugin_calls.internal("the robot's frames", exc)
        if goal.frame != target:
            x, y, _ = active.pose
            self._emit(
                now, "info", f'the goal lies at ({x:.3f}, {y:.3f}) in "{target}"', {"goal_pose": list(active.pose)}
            )
        return None

    def _preempted(self, now: float) -> bool:
        """Looks at the preempt flag, as C++ does at the top of its loop; True when there is no goal any more."""
        if not self.server.preempt_requested:
            return False
        if not self.server.is_new_goal_available:
            self._apply(NavEvent.CANCELED, now)
            return True
        active = self._active_goal
        if active is not None:
            error = GoalReplacedError(f"another goal came after {active.age(now):.1f} s")
            result = active.result(GoalStatus.PREEMPTED, status_messages.REPLACED, error, now)
            self.server.set_preempted(now, status_messages.REPLACED, result)
        if self._accept(now).error is not None:
            self._apply(NavEvent.GOAL_INVALID, now)
            return True
        self._apply(NavEvent.GOAL_REPLACED, now)
        return False

    def _is_out_of_time(self, now: float) -> bool:
        """Ends the goal when its own time limit is over; C++ has none."""
        active = self._active_goal
        if active is None or now < active.deadline - EPSILON_S:
            return False
        limit = active.deadline - (active.handle.accepted_at or 0.0)
        error = GoalTimeLimitError(
            f"the goal was not reached within its time limit of {limit:g} s", time_limit_s=limit, pose=self._pose
        )
        self._end_with(NavEvent.TIMED_OUT, error, now)
        return True

    # --- the control cycle --------------------------------------------------------------------------------------------

    def _cycle(self, now: float) -> None:
        self._control.advance(now)
        if self._preempted(now) or self._is_out_of_time(now):
            return
        if self.global_costmap.frame != self._goal_frame and self._active_goal is not None:
            self._goal_frame = self.global_costmap.frame
            self._plan = self._new_plan = None
            self._active_goal.pose = None
            self._progress.reset()
            self._apply(NavEvent.FRAME_CHANGED, now)
        self._watch(now)
        if self._is_stale(now):
            return
        if self._new_plan is not None and not self._take_plan(self._new_plan, now):
            return
        self._apply(NavEvent.CYCLE, now)
        mode = self._state.mode
        if mode is Mode.CONTROLLING:
            self._drive(now)
        elif mode is Mode.CLEARING:
            self._clear(now)
        elif mode is Mode.PLANNING:
            self._check_slow_planner(now)
        # a command is good for one period; nothing came after it
        old = now - self._command_time >= 2.0 * self._control.period - EPSILON_S
        if old and self._command != STANDING and self._recovery.running is None and self._has_goal():
            self._send(STANDING, now)

    def _watch(self, now: float) -> None:
        """Finds the robot: feedback, and whether it gets anywhere."""
        try:
            pose = self.global_costmap.robot_pose(now)
        except Exception:
            # whoever needs the pose will say so: planning, control
            self._pose = None
            return
        active = self._active_goal
        if not pose.is_finite() or active is None:
            self._pose = None
            return
        if self._pose is not None:
            active.driven_m += self._pose.distance_to(pose)
        self._pose = active.statistics.pose = pose
        progress = self._progress.update(pose)
        if progress is not Progress.NONE:
            self._last_progress = now
            if progress is Progress.MOVED:
                active.rounds = 0
                self._apply(NavEvent.MOVED, now)
        # most runs have nobody who listens to it
        if any(getattr(listener, "hears_feedback", True) for listener in self.listeners):
            self._emit(now, "feedback", "", {"pose": list(pose)})
        if self._followed:
            self._follow_up(now)

    def _follow_up(self, now: float) -> None:
        try:
            state = self._costmap_updater.local_state(now)
        except NavError:
            return
        for recovery in list(self._followed):
            try:
                goes_on = recovery.follow_up(state, now)
            except Exception as exc:
                self._warn(now, f"{recovery.name}: {describe(exc)}")
                goes_on = False
            if not goes_on:
                self._followed.remove(recovery)

    def _is_stale(self, now: float) -> bool:
        """Stops the robot while a sensor is silent, and ends the goal when it stays so (parity 23)."""
        silent, cause = self._costmap_updater.staleness(now)
        if not silent:
            self._stale_since = None
            return False
        if self._stale_since is None:
            self._stale_since = now
            self._warn(now, status_messages.LOG_STALE.format(name=self.local_costmap.name), cause)
        active = self._active_goal
        since = now - self._stale_since
        error = cause or StaleSensorsError(
            f"a sensor of {self.local_costmap.name} is silent for longer than its expected_update_rate, and came to no "
            f"word within controller_patience ({self.params.controller_patience:g} s)",
            costmap=self.local_costmap.name,
            since=self._stale_since,
        )
        if active is not None:
            active.statistics.stale_cycles += 1
        if since >= self.params.controller_patience - EPSILON_S:
            if active is not None:
                active.statistics.failed(error, now)
            self._end_with(NavEvent.SENSORS_LOST, error, now)
        else:
            self._apply(NavEvent.SENSORS_STALE, now)
        return True

    def _take_plan(self, plan: Plan, now: float) -> bool:
        """Hands a new plan to the local planner; False when it refuses and the goal has ended."""
        self._new_plan = None
        try:
            self.local_planner.set_plan(plan.path, plan.goal)
        except NavError as exc:
            error: NavError = exc
        except Exception as exc:
            error = plugin_calls.internal(type(self.local_planner).__name__, exc)
        else:
            self._apply(NavEvent.PLAN_TAKEN, now)
            self._emit(now, "info", status_messages.LOG_NEW_PLAN, {})
            return True
        if self._active_goal is not None:
            self._active_goal.statistics.failed(error, now)
        self._end_with(NavEvent.PLAN_REFUSED, error, now)
        return False

    def _drive(self, now: float) -> None:
        active = self._active_goal
        assert active is not None and self._plan is not None
        error: NavError | None = None
        inputs: ControlInput | None = None
        try:
            inputs = self._costmap_updater.control_input(self._plan, now)
            if plugin_calls.goal_reached(self.local_planner, inputs):
                self._emit(now, "info", status_messages.LOG_REACHED, {})
                self._apply(NavEvent.GOAL_REACHED, now)
                return
        except NavError as exc:
            error = exc
        timeout = self.params.oscillation_timeout
        if timeout > 0.0 and now >= self._last_progress + timeout - EPSILON_S:
            self._give_up_moving(active, timeout, now)
            return
        if error is None and inputs is not None:
            try:
                if self._speed_limiter.apply(now, slowed=bool(self._followed)):
                    limit = self._speed_limiter.limit
                    text = "no speed limit any more" if limit is None else f"speed limit {limit:.2f} m/s"
                    self._emit(now, "info", f"{text}, says the speed mask", {"max_vel_trans": limit})
                local = plugin_calls.compute_command(self.local_planner, inputs)
                self._local_plan = self.last_tick.local_plan = local
                active.statistics.commands += 1
                self._send(local.command, now)
                self._apply(NavEvent.COMMAND_FOUND, now)
                return
            except NavError as exc:
                error = exc
        assert error is not None
        self._failed_command(active, error, now)

    def _give_up_moving(self, active: ActiveGoal, timeout: float, now: float) -> None:
        active.error = NoProgressError(
            f"the robot came no further than {self.params.oscillation_distance:g} m for {timeout:g} s",
            oscillation_timeout=timeout,
            oscillation_distance=self.params.oscillation_distance,
            pose=self._pose,
        )
        active.statistics.failed(active.error, now)
        self._emit(now, "control_failed", active.error.message, active.error.as_dict())
        self._apply(NavEvent.OSCILLATING, now)

    def _failed_command(self, active: ActiveGoal, error: NavError, now: float) -> None:
        statistics = active.statistics
        statistics.failed_commands += 1
        statistics.last_control = error
        statistics.failed(error, now)
        self._emit(now, "control_failed", error.message, error.as_dict())
        patience = self.params.controller_patience
        exhausted = now >= self._last_valid_control + patience - EPSILON_S
        self._apply(NavEvent.CONTROL_EXHAUSTED if exhausted else NavEvent.COMMAND_FAILED, now)

    # --- planning -----------------------------------------------------------------------------------------------------

    def _ask_planner(self, now: float) -> None:
        if self._state.mode is Mode.CLEARING or self._planning.is_busy or not self._plan_schedule.take_turn(now):
            return
        active = self._active_goal
        assert active is not None
        try:
            if active.pose is None:
                error = self._locate_goal(active, now)
                if error is not None:
                    raise error
            assert active.pose is not None
            start = self.global_costmap.robot_pose(now)
            if not start.is_finite():
                raise InternalError(f"the robot's pose {tuple(start)} is not finite", pose=start)
        except Exception as exc:
            problem = exc if isinstance(exc, NavError) else plugin_calls.internal("the robot's frames", exc)
            self._hear(PlanAnswer(active.handle.id, now, None, problem), now)
            return
        costmap = self.global_costmap
        self._planning.request(
            PlanRequest(
                self.global_planner, costmap.master, start, active.pose, costmap.footprint, active.handle.id, now
            )
        )
        answer = self._planning.poll(now)
        if answer is not None:
            self._hear(answer, now)

    def _hear(self, answer: PlanAnswer, now: float) -> None:
        """Takes in what the planner said; a plan for a goal that is no more is not one."""
        active = self._active_goal
        if active is None or answer.goal_id != active.handle.id or not self._has_goal():
            return
        if answer.plan is not None and answer.plan.path.frame == self.global_costmap.frame:
            self._found_plan(active, answer.plan, now)
        elif answer.error is not None:
            self._failed_plan(active, add_layer(self.global_costmap, answer.error), now)

    def _found_plan(self, active: ActiveGoal, plan: Plan, now: float) -> None:
        active.statistics.plans += 1
        if self._state.mode is not Mode.CLEARING:
            self._plan = self._new_plan = plan
            self.last_tick.plan = plan
        self._plan_schedule.found()
        if self.listeners:
            length = plan.path.length
            data: dict[str, Any] = {
                "length_m": length,
                "poses": len(plan.path),
                "cost": plan.cost,
                "cells_expanded": plan.cells_expanded,
                "goal_moved_m": plan.goal_moved_m,
                "notes": list(plan.notes),
            }
            self._emit(now, "plan", f"a plan of {length:.2f} m, {len(plan.path)} poses", data)
        self._apply(NavEvent.PLAN_FOUND, now)

    def _failed_plan(self, active: ActiveGoal, error: NavError, now: float) -> None:
        statistics = active.statistics
        statistics.failed_plans += 1
        statistics.last_planning = error
        statistics.failed(error, now)
        self._emit(now, "plan_failed", error.message, error.as_dict())
        if self._state.mode is not Mode.PLANNING:
            self._apply(NavEvent.PLAN_FAILED, now)
            return
        exhausted = self._plan_schedule.failed(now)
        self._apply(NavEvent.PLANNING_EXHAUSTED if exhausted else NavEvent.PLAN_FAILED, now)

    def _check_slow_planner(self, now: float) -> None:
        """C++ waits for ever for a planner that does not return. Here patience ends; a late plan is welcome all the same."""
        active = self._active_goal
        waited = self._plan_schedule.waited(now)
        if active is None or not self._planning.is_busy or waited < self.params.planner_patience - EPSILON_S:
            return
        error = PlanningTimeoutError(
            f"the global planner has not answered for {waited:.1f} s (planner_patience "
            f"{self.params.planner_patience:g} s)",
            waited_s=waited,
        )
        self._failed_plan(active, error, now)

    # --- recovery -----------------------------------------------------------------------------------------------------

    def _clear(self, now: float) -> None:
        active = self._active_goal
        assert active is not None
        index = self._state.recovery_index
        left = self.params.recovery_behavior_enabled and index < len(self.recoveries)
        if left and active.rounds < MAX_RECOVERY_ROUNDS * len(self.recoveries):
            self._apply(NavEvent.RECOVERY_BEGINS, now)
            return
        log = {
            Trigger.PLANNING_R: status_messages.LOG_NO_PLAN,
            Trigger.CONTROLLING_R: status_messages.LOG_NO_CONTROL,
            Trigger.OSCILLATION_R: status_messages.LOG_OSCILLATING,
        }[self._state.trigger]
        if left:
            self._warn(
                now,
                f"{active.rounds} recoveries in a row did not bring the robot {self.params.oscillation_distance:g} m "
                "further: the list is not begun once more",
            )
        self._warn(now, log)
        self._apply(NavEvent.RECOVERIES_EXHAUSTED, now)

    def _start_recovery(self, now: float) -> None:
        active = self._active_goal
        assert active is not None
        recovery = self.recoveries[self._state.recovery_index]
        active.statistics.recoveries.append(recovery.name)
        active.rounds += 1
        ended = self._recovery.start(recovery, self._context, now)
        if ended is None:
            ended = self._recovery.step(recovery, self.local_state, self._send, now)
        if ended is not None:
            self._end_recovery(ended, now)

    def _recover(self, recovery: RecoveryBehavior, now: float) -> None:
        """A turn of a recovery that runs: unlike in C++, cancels, new goals and silent sensors are seen (parity 22)."""
        runner = self._recovery
        polled, stepped = runner.take_turn(now)
        if not polled or self._preempted(now) or self._is_out_of_time(now):
            return
        if runner.running is not recovery or self._is_stale(now):
            return
        ended = runner.overrun(recovery, now)
        if ended is None and stepped:
            ended = runner.step(recovery, self.local_state, self._send, now)
        if ended is not None:
            self._end_recovery(ended, now)

    def _end_recovery(self, ended: Ended, now: float) -> None:
        recovery, status, text, data, error = ended
        if error is not None and self._active_goal is not None:
            self._active_goal.statistics.failed(error, now)
        self._tell_recovery(recovery, status, text or f"{recovery.name} ends", data, now)
        if recovery not in self._followed:
            self._followed.append(recovery)
        began = self._recovery.began
        self._apply(NavEvent.RECOVERY_ENDED, now)
        if now > began:
            # as ros::Rate after a cycle that took long: the next cycle is now
            self._control.restart(began)
            self._control.advance(began)
            self._control.resume(now)

    def _tell_recovery(
        self, recovery: RecoveryBehavior, status: RecoveryStatus, text: str, data: dict[str, Any], now: float
    ) -> None:
        if not self.listeners:
            return
        about: dict[str, Any] = {
            "name": recovery.name,
            "type": type(recovery).__name__,
            "index": self._state.recovery_index,
            "total": len(self.recoveries),
            "status": status.value,
            "trigger": self._state.trigger.name,
        }
        self._emit(now, "recovery", text, {**data, **about})

    # --- carrying out -------------------------------------------------------------------------------------------------

    def _end_with(self, event: NavEvent, error: NavError, now: float) -> None:
        if self._active_goal is not None:
            self._active_goal.error = error
        self._apply(event, now)

    def _apply(self, event: NavEvent, now: float) -> None:
        """Steps the state machine and does what it says."""
        before = self._state
        try:
            state, row = step(before, event)
        except InternalError as exc:
            if self._active_goal is not None:
                self._active_goal.error = exc
            state = NavState()
            row = Transition(
                before.mode,
                event,
                Mode.IDLE,
                (Action.STOP_PLANNER, Action.DROP_RECOVERY, Action.STOP, Action.STOP_COSTMAPS),
                Outcome.BAD_STATE,
            )
        self._state = state
        if state.mode is not before.mode and self.listeners:
            self._emit(
                now,
                "state",
                f"{before.mode.value} -> {state.mode.value}: {event.value}",
                {
                    "from": before.mode.value,
                    "to": state.mode.value,
                    "event": event.name,
                    "trigger": state.trigger.name,
                    "recovery_index": state.recovery_index,
                },
            )
        for action in row.actions:
            self._do(action, now)
        if row.outcome is not None:
            self._finish(row.outcome, now)

    def _do(self, action: Action, now: float) -> None:
        match action:
            case Action.RESET_CONTROL_PATIENCE:
                self._last_valid_control = now
            case Action.STOP:
                self._send(STANDING, now)
            case Action.STOP_IF_MOVING:
                if self._command != STANDING:
                    self._send(STANDING, now)
            case Action.WAKE_PLANNER:
                self._plan_schedule.wake()
            case Action.STOP_PLANNER:
                self._plan_schedule.stop()
            case Action.RESET_TIMERS:
                self._plan_schedule.reset_patience(now)
                self._last_valid_control = now
            case Action.RESET_PLAN_PATIENCE:
                self._plan_schedule.reset_patience(now)
            case Action.RESET_OSCILLATION:
                self._last_progress = now
            case Action.START_RECOVERY:
                self._start_recovery(now)
            case Action.DROP_RECOVERY:
                self._recovery.drop()
            case Action.START_COSTMAPS:
                self._costmap_updater.switch(True, now)
            case Action.STOP_COSTMAPS:
                self._costmap_updater.switch(not self.params.shutdown_costmaps, now)

    def _send(self, twist: Twist2D, now: float) -> None:
        self._command = self.last_tick.command = twist
        self._command_time = now
        try:
            self.robot.command(twist)
        except Exception as exc:
            if self._driver_error is None:
                error = exc if isinstance(exc, NavError) else plugin_calls.internal("the robot", exc)
                self._driver_error = error
                self._warn(now, f"the robot does not take the command {tuple(twist)}: {error.message}", error)

    def _finish(self, outcome: Outcome, now: float) -> None:
        """The goal at hand ends."""
        active = self._active_goal
        if active is None:
            return
        self._active_goal = None
        self._stale_since = None
        self._plan = self._new_plan = None
        text = outcome.value
        if outcome is Outcome.REACHED:
            self.server.set_succeeded(now, text, active.result(GoalStatus.SUCCEEDED, text, None, now))
            return
        error = active.reason(outcome, now)
        if outcome is Outcome.CANCELED:
            self.server.set_preempted(now, text, active.result(GoalStatus.PREEMPTED, text, error, now))
            return
        if outcome is Outcome.BAD_QUATERNION and not active.handle.goal.pose.is_finite():
            text = (
                status_messages.BAD_QUATERNION
                if not active.handle.goal.has_valid_orientation
                else status_messages.BAD_POSITION
            )
        self.server.set_aborted(now, text, active.result(GoalStatus.ABORTED, text, error, now))

    # --- services -----------------------------------------------------------------------------------------------------

    def clear_costmaps(self) -> int:
        """move_base's service of that name: resets every layer of both costmaps; cells cleared."""
        return self.local_costmap.reset() + self.global_costmap.reset()

    def make_plan(self, goal: Pose2D, start: Pose2D | None = None, *, tolerance: float = 0.0) -> Plan:
        """move_base's service of that name: a plan without driving, in the global costmap's frame.

        `start` is the robot's pose when None. When the goal itself cannot be reached, the first that can on square rings
        around it, up to `tolerance` (m) away, takes its place; `make_plan_add_unreachable_goal` then appends the goal.
        `make_plan_clear_costmap` plans as if nothing was within `clearing_radius` of the robot.

        Raises BusyError while there is a goal, and the planner's error for the goal itself when nothing is found.

        ROS differs: there the square is cleared in the real costmaps, and "nothing found" is an empty plan.
        """
        if self._has_goal():
            raise BusyError(status_messages.LOG_BUSY)
        if self._planning.is_using(self.global_planner):
            raise BusyError("the global planner still works on a plan that nobody waits for; try again in a while")
        return make_plan(
            self.global_planner,
            self.global_costmap,
            self.params,
            goal,
            start,
            tolerance=tolerance,
            now=self._now if self._ticked else None,
        )

    # --- telling ------------------------------------------------------------------------------------------------------

    def _on_status(self, handle: GoalHandle, now: float) -> None:
        if self.listeners:
            data: dict[str, Any] = {"id": handle.id, "status": handle.status.name, "number": int(handle.status)}
            if handle.is_done:
                result = handle.result
                data |= {"error_code": result.error_code, "error_name": result.error_name, "message": result.message}
            text = f"{handle.status.name}: {handle.text}" if handle.text else handle.status.name
            self._emit(now, "status", text, {**data, "text": handle.text})

    def _emit(self, now: float, kind: str, text: str, data: dict[str, Any]) -> None:
        if self.listeners:
            event = Event(now, kind, text, data)
            for listener in self.listeners:
                listener.on_event(event)

    def _warn(self, now: float, text: str, error: NavError | None = None) -> None:
        self._emit(now, "warning", text, {} if error is None else error.as_dict())
