"""The goal manager: takes goals, keeps the costmaps fresh, plans, drives, recovers, and ends every goal with a reason.

Source: move_base/src/move_base.cpp. One turn of the crank is `MoveBase.tick(now)`: sense, update the costmaps that are due,
drive or recover, plan. A plan is taken up by the control cycle after the one that asked for it, as in C++, where it
comes from another thread a few milliseconds later. Nothing here sleeps, starts a thread or reads a clock.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from navstack.core import (
    Bounds,
    Event,
    Listener,
    Path,
    Pose2D,
    RobotState,
    SensorData,
    Transform2D,
    Twist2D,
    Window,
)
from navstack.core.errors import FrameError, InputError, InternalError, NavError, PlanningError, PlanningTimeoutError
from navstack.core.frames import clean_frame
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
from navstack.move_base import guards, texts
from navstack.move_base.action_server import SimpleActionServer
from navstack.move_base.errors import (
    BusyError,
    GoalCanceledError,
    GoalReplacedError,
    InvalidGoalError,
    NoProgressError,
    RecoveryTimeoutError,
    ShutdownError,
    StaleSensorsError,
)
from navstack.move_base.goal import Goal, GoalHandle, GoalResult, Quaternion, yaw_of
from navstack.move_base.goal_status import GoalStatus
from navstack.move_base.params import MoveBaseParams
from navstack.move_base.planning import InlinePlanning, PlanAnswer, Planning
from navstack.move_base.progress import Progress, ProgressChecker
from navstack.move_base.schedule import EPSILON_S, Schedule
from navstack.move_base.speed_masks import SpeedMasks
from navstack.move_base.state_machine import Action, Mode, NavEvent, NavState, Outcome, Transition, Trigger, step
from navstack.move_base.tally import Tally

STANDING = Twist2D()
DEFAULT_UPDATE_FREQUENCY = 5.0
"""Hz; costmap_2d's, for costmap servers that have no word on it."""
MAX_RECOVERY_ROUNDS = 3
"""How often the list of recoveries is run through without the robot getting anywhere, whatever resets the index."""


@dataclass(frozen=True, slots=True)
class Feedback:
    """Where the robot stands with its goal."""

    pose: Pose2D | None
    """The robot in the global costmap's frame; None when it is not known."""
    mode: Mode
    distance_remaining: float
    """m along the plan, from the point of it nearest to the robot; straight to the goal without a plan."""
    navigation_time: float
    """s since the goal was accepted."""
    estimated_time_remaining: float | None
    """s at the mean speed so far; None while that says nothing."""
    recoveries: int


@dataclass(slots=True)
class Turn:
    """What one tick did: for recorders, who want to know without asking twice."""

    time: float
    scans: tuple[SensorData, ...] = ()
    global_window: Window | None = None
    """The cells of the global costmap that were rewritten; None when it was not updated."""
    local_window: Window | None = None
    plan: Plan | None = None
    """The plan that arrived."""
    local_plan: LocalPlan | None = None
    """The local plan that was made."""
    command: Twist2D | None = None
    """The last command sent."""


@dataclass(slots=True)
class _Mission:
    """Everything that belongs to the goal being worked on."""

    handle: GoalHandle
    tally: Tally = field(default_factory=Tally)
    pose: Pose2D | None = None
    """The goal in the global costmap's frame; None while it cannot be transformed."""
    error: NavError | None = None
    """Why the goal is to end, where the outcome alone does not say."""
    driven_m: float = 0.0
    rounds: int = 0
    """Recoveries since the robot last moved oscillation_distance."""


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
    ) -> None:
        """`planning` says how long planning takes (none at all when None). The update frequencies (Hz) are those of the
        costmaps' own parameters unless given. A recovery that runs longer than `recovery_time_limit_s` has failed.

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
        self.recovery_time_limit_s = recovery_time_limit_s
        self.server = SimpleActionServer(self._on_status)
        self.turn = Turn(0.0)
        """What the last tick did."""
        self._planning: Planning = planning or InlinePlanning()
        self._state = NavState()
        self._now = 0.0
        self._ticked = False
        self._goal_count = 0
        self._shut_down = False
        # schedules
        self._control = Schedule(params.controller_frequency)
        self._replan = Schedule(params.planner_frequency)
        self._global_update = Schedule(_update_frequency(global_costmap, global_update_frequency))
        self._local_update = Schedule(_update_frequency(local_costmap, local_update_frequency))
        self._costmaps_on = not params.shutdown_costmaps
        self._global_error: NavError | None = None
        self._local_error: NavError | None = None
        # the goal at hand
        self._mission: _Mission | None = None
        self._goal_frame = ""
        self._plan: Plan | None = None
        self._new_plan: Plan | None = None
        self._local_plan: LocalPlan | None = None
        self._wake_planner = False
        self._planner_on = False
        self._retries = 0
        self._last_valid_plan = 0.0
        self._last_valid_control = 0.0
        self._last_progress = 0.0
        self._stale_since: float | None = None
        self._progress = ProgressChecker(params.oscillation_distance)
        self._pose: Pose2D | None = None
        self._speed_masks = SpeedMasks((local_costmap, global_costmap), local_planner)
        # commands
        self._command = STANDING
        self._command_time = -math.inf
        self._driver_error: NavError | None = None
        # recovery
        self._context = RecoveryContext(global_costmap, local_costmap, local_planner, params.controller_frequency)
        self._recovery: RecoveryBehavior | None = None
        self._recovery_began = 0.0
        self._recovery_steps = Schedule(params.controller_frequency)
        self._recovery_polls = Schedule(params.controller_frequency)
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
        return self._recovery.name if self._recovery is not None else None

    @property
    def recovery_context(self) -> RecoveryContext:
        """What a recovery behaviour may act on, for those who run one themselves while there is no goal."""
        return self._context

    @property
    def goal_handle(self) -> GoalHandle | None:
        """The goal being worked on."""
        return self._mission.handle if self._mission is not None else None

    @property
    def goal_pose(self) -> Pose2D | None:
        """That goal in the global costmap's frame."""
        return self._mission.pose if self._mission is not None else None

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
        mission = self._mission
        if mission is None:
            return Feedback(self._pose, self._state.mode, 0.0, 0.0, None, 0)
        begun = mission.handle.accepted_at
        spent = self._now - begun if begun is not None else 0.0
        left = self._distance_remaining(mission)
        speed = mission.driven_m / spent if spent > 0.0 else 0.0
        return Feedback(
            self._pose,
            self._state.mode,
            left,
            spent,
            left / speed if speed > 0.01 else None,
            len(mission.tally.recoveries),
        )

    # --- goals --------------------------------------------------------------------------------------------------------

    def send_goal(
        self,
        pose: Pose2D,
        frame: str | None = None,
        *,
        orientation: Quaternion | None = None,
        goal_id: str | None = None,
        stamp: float | None = None,
    ) -> GoalHandle:
        """Asks for `pose` (m, rad) in `frame` (the global costmap's when None); any goal before it is replaced.

        With `orientation` (x, y, z, w) the heading is that quaternion's. `stamp` (s) is the time of the last tick unless
        given; goals stamped before the one at hand are RECALLED. What is wrong with a goal shows in the handle, which
        reaches a terminal state in any case.
        """
        self._goal_count += 1
        if orientation is not None:
            yaw = yaw_of(orientation) if all(math.isfinite(c) for c in orientation) else math.nan
            pose = Pose2D(pose.x, pose.y, yaw)
        stamp = self._now if stamp is None else stamp
        if not math.isfinite(stamp):
            raise InputError(f"a goal's stamp is a time in seconds, not {stamp}", stamp=stamp)
        name = goal_id or f"goal-{self._goal_count}"
        goal = Goal(pose, clean_frame(frame or self.global_costmap.frame), name, stamp, orientation)
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

        Recoveries and costmaps stay; `navstack.navigator.reconfigure` makes the planners from a
        configuration. Raises InputError for what is no planner, a ParameterError when a recovery does not fit.
        """
        guards.check_plugin(global_planner, GlobalPlanner)
        guards.check_plugin(local_planner, LocalPlanner)
        params = params or self.params
        driver = local_planner or self.local_planner
        context = RecoveryContext(self.global_costmap, self.local_costmap, driver, params.controller_frequency)
        for recovery in self.recoveries:
            recovery.check(context)
        masks = SpeedMasks((self.local_costmap, self.global_costmap), driver) if local_planner else self._speed_masks
        # nothing can fail from here on
        now = self._now
        self._context = context
        self._set_params(params, now)
        if global_planner is None and local_planner is None:
            return
        self.global_planner = global_planner or self.global_planner
        if local_planner is not None:
            self.local_planner = local_planner
            self._speed_masks = masks
            self._followed.clear()  # limits that recoveries set were those of the old one
        self._planning.abandon()
        self._plan = self._new_plan = self._local_plan = None
        names = f"{type(self.global_planner).__name__}, {type(self.local_planner).__name__}"
        self._emit(now, "info", f"planners changed: {names}", {})
        self._apply(NavEvent.PLANNERS_CHANGED, now)

    def _set_params(self, params: MoveBaseParams, now: float) -> None:
        before, self.params = self.params, params
        if params.controller_frequency != before.controller_frequency:
            self._control = Schedule(params.controller_frequency, now)
            self._recovery_polls = Schedule(params.controller_frequency, now)
        if params.planner_frequency != before.planner_frequency:
            self._replan = Schedule(params.planner_frequency, now)
            # C++ wakes the planner thread: with a frequency it plans again, without it waits
            self._planner_on = self._state.mode in (Mode.PLANNING, Mode.CONTROLLING) and (
                self._planner_on or params.planner_frequency > 0.0
            )
        if params.oscillation_distance != before.oscillation_distance:
            self._progress = ProgressChecker(params.oscillation_distance)
        if params.shutdown_costmaps != before.shutdown_costmaps:
            on = self._active() or not params.shutdown_costmaps
            if on and not self._costmaps_on:
                self._global_update.restart(now)
                self._local_update.restart(now)
            self._costmaps_on = on

    # --- the crank ----------------------------------------------------------------------------------------------------

    def next_due(self, now: float) -> float:
        """When `tick` has something to do next (s), `now` at the earliest; inf for never."""
        if not self._ticked or (self._state.mode is Mode.IDLE and self.server.is_new_goal_available):
            return now
        due = min(self._global_update.due, self._local_update.due) if self._costmaps_on else math.inf
        mode = self._state.mode
        if mode is not Mode.IDLE:
            if self._recovery is not None:
                due = min(due, self._recovery_steps.due, self._recovery_polls.due)
            else:
                due = min(due, self._control.due)
            due = min(due, self._planning.due)
            if self._planner_on and not self._planning.is_busy and mode is not Mode.CLEARING:
                due = min(due, self._replan.due)
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
            for schedule in (self._global_update, self._local_update):
                schedule.restart(now)
        self._now = now
        self.turn = Turn(now)
        self._sense(now)
        if self._state.mode is Mode.IDLE and self.server.is_new_goal_available:
            self._begin(now)
        self._update_costmaps(now)
        if self._state.mode is Mode.IDLE:
            return
        answer = self._planning.poll(now)
        if answer is not None:
            self._hear(answer, now)
        if self._recovery is not None:
            self._recover(now)
        if self._active() and self._recovery is None and self._control.is_due(now):
            self._cycle(now)
        if self._active():
            self._ask_planner(now)
        if self._driver_error is not None and self._active():
            self._end_with(NavEvent.DRIVER_FAILED, self._driver_error, now)

    def shutdown(self) -> None:
        """Ends every goal ("node has been killed") and stops the robot; goals that come later end at once."""
        self._shut_down = True
        self._apply(NavEvent.SHUTDOWN, self._now)
        while self.server.is_new_goal_available:
            self._begin(self._now)

    def _active(self) -> bool:
        return self._state.mode is not Mode.IDLE

    # --- sensing ------------------------------------------------------------------------------------------------------

    def _sense(self, now: float) -> None:
        try:
            scans = tuple(self.robot.scans())
        except Exception as exc:
            self._warn(now, f"no scans from the robot: {_said(exc)}")
            return
        self.turn.scans = scans
        for data in scans:
            for costmap in (self.local_costmap, self.global_costmap):
                try:
                    costmap.observe(data)
                except Exception as exc:
                    self._warn(now, f"{costmap.name} cannot use a message of {data.topic}: {_said(exc)}")

    def _update_costmaps(self, now: float) -> None:
        if not self._costmaps_on:
            return
        if self._global_update.is_due(now):
            self._global_update.advance(now)
            self.turn.global_window, self._global_error = self._updated(self.global_costmap, now, self._global_error)
        if self._local_update.is_due(now):
            self._local_update.advance(now)
            self.turn.local_window, self._local_error = self._updated(self.local_costmap, now, self._local_error)

    def _updated(
        self, costmap: CostmapServer, now: float, before: NavError | None
    ) -> tuple[Window | None, NavError | None]:
        try:
            return costmap.update(now), None
        except NavError as exc:
            error: NavError = exc
        except Exception as exc:
            error = guards.internal(costmap.name, exc)
        if before is None:
            self._warn(now, f"{costmap.name} could not be updated: {error.message}", error)
        return None, error

    # --- goals begin --------------------------------------------------------------------------------------------------

    def _begin(self, now: float) -> None:
        """Takes the waiting goal, when there is none at hand."""
        mission = self._accept(now)
        if self._shut_down:
            self._apply(NavEvent.GOAL_ACCEPTED, now)
            self._apply(NavEvent.SHUTDOWN, now)
        elif mission.error is not None:
            self._apply(NavEvent.GOAL_INVALID, now)
        else:
            self._control.restart(now)
            self._driver_error = None
            # a costmap that failed before gets its chance before the goal is judged by it
            if self._global_error is not None:
                self._global_update.restart(now)
            if self._local_error is not None:
                self._local_update.restart(now)
            self._apply(NavEvent.GOAL_ACCEPTED, now)

    def _accept(self, now: float) -> _Mission:
        handle = self.server.accept(now)
        mission = self._mission = _Mission(handle)
        goal = handle.goal
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
        if not goal.has_valid_orientation:
            mission.error = InvalidGoalError(
                f"the goal's orientation {goal.orientation or goal.pose.yaw} is no heading in the plane; give a unit "
                "quaternion about z, or a finite yaw",
                orientation=goal.orientation,
                yaw=goal.pose.yaw,
            )
        elif not goal.pose.is_finite():
            mission.error = InvalidGoalError(
                f"the goal's position ({goal.pose.x}, {goal.pose.y}) is not finite; give metres in a frame",
                pose=goal.pose,
            )
        else:
            self._goal_frame = self.global_costmap.frame
            self._locate_goal(mission, now)
        return mission

    def _locate_goal(self, mission: _Mission, now: float) -> NavError | None:
        """Brings the goal into the global costmap's frame; the error when that cannot be done (yet)."""
        goal = mission.handle.goal
        target = self.global_costmap.frame
        try:
            mission.pose = self.robot.frames.lookup(target, goal.frame).apply(goal.pose)
        except NavError as exc:
            return exc
        except Exception as exc:
            return guards.internal("the robot's frames", exc)
        if goal.frame != target:
            self._emit(now, "info", f'the goal lies at ({mission.pose.x:.3f}, {mission.pose.y:.3f}) in "{target}"', {})
        return None

    def _preempted(self, now: float) -> bool:
        """Looks at the preempt flag, as C++ does at the top of its loop; True when there is no goal any more."""
        if not self.server.preempt_requested:
            return False
        if not self.server.is_new_goal_available:
            self._apply(NavEvent.CANCELED, now)
            return True
        mission = self._mission
        if mission is not None:
            error = GoalReplacedError(f"another goal came after {self._age(mission, now):.1f} s")
            result = self._result(mission, GoalStatus.PREEMPTED, texts.REPLACED, error, now)
            self.server.set_preempted(now, texts.REPLACED, result)
        if self._accept(now).error is not None:
            self._apply(NavEvent.GOAL_INVALID, now)
            return True
        self._apply(NavEvent.GOAL_REPLACED, now)
        return False

    # --- the control cycle --------------------------------------------------------------------------------------------

    def _cycle(self, now: float) -> None:
        self._control.advance(now)
        if self._preempted(now):
            return
        if self.global_costmap.frame != self._goal_frame and self._mission is not None:
            self._goal_frame = self.global_costmap.frame
            self._plan = self._new_plan = None
            self._mission.pose = None
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
        unattended = self._active() and self._recovery is None and self._command != STANDING
        if unattended and now - self._command_time >= 2.0 * self._control.period - EPSILON_S:
            self._send(STANDING, now)

    def _watch(self, now: float) -> None:
        """Finds the robot: feedback, and whether it gets anywhere."""
        try:
            pose = self.global_costmap.robot_pose(now)
        except Exception:
            # whoever needs the pose will say so: planning, control
            self._pose = None
            return
        mission = self._mission
        if not pose.is_finite() or mission is None:
            self._pose = None
            return
        if self._pose is not None:
            mission.driven_m += self._pose.distance_to(pose)
        self._pose = mission.tally.pose = pose
        progress = self._progress.update(pose)
        if progress is not Progress.NONE:
            self._last_progress = now
            if progress is Progress.MOVED:
                mission.rounds = 0
                self._apply(NavEvent.MOVED, now)
        if self.listeners:
            self._emit(now, "feedback", "", {"pose": list(pose)})
        if self._followed:
            self._follow_up(now)

    def _follow_up(self, now: float) -> None:
        try:
            state = self.local_state(now)
        except NavError:
            return
        for recovery in list(self._followed):
            try:
                goes_on = recovery.follow_up(state, now)
            except Exception as exc:
                self._warn(now, f"{recovery.name}: {_said(exc)}")
                goes_on = False
            if not goes_on:
                self._followed.remove(recovery)

    def _is_stale(self, now: float) -> bool:
        """Stops the robot while a sensor is silent, and ends the goal when it stays so (parity 23)."""
        cause = self._local_error
        if cause is None:
            try:
                current = self.local_costmap.is_current(now)
            except Exception as exc:
                current, cause = False, guards.internal(self.local_costmap.name, exc)
            if current:
                self._stale_since = None
                return False
        if self._stale_since is None:
            self._stale_since = now
            self._warn(now, texts.LOG_STALE.format(name=self.local_costmap.name), cause)
        mission = self._mission
        since = now - self._stale_since
        error = cause or StaleSensorsError(
            f"a sensor of {self.local_costmap.name} is silent for longer than its expected_update_rate, and came to no "
            f"word within controller_patience ({self.params.controller_patience:g} s)",
            costmap=self.local_costmap.name,
            since=self._stale_since,
        )
        if mission is not None:
            mission.tally.stale_cycles += 1
        if since >= self.params.controller_patience - EPSILON_S:
            if mission is not None:
                mission.tally.failed(error, now)
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
            error = guards.internal(type(self.local_planner).__name__, exc)
        else:
            self._apply(NavEvent.PLAN_TAKEN, now)
            self._emit(now, "info", texts.LOG_NEW_PLAN, {})
            return True
        if self._mission is not None:
            self._mission.tally.failed(error, now)
        self._end_with(NavEvent.PLAN_REFUSED, error, now)
        return False

    def _drive(self, now: float) -> None:
        mission = self._mission
        assert mission is not None and self._plan is not None
        error: NavError | None = None
        inputs: ControlInput | None = None
        try:
            inputs = self._inputs(self._plan, now)
            if guards.goal_reached(self.local_planner, inputs):
                self._emit(now, "info", texts.LOG_REACHED, {})
                self._apply(NavEvent.GOAL_REACHED, now)
                return
        except NavError as exc:
            error = exc
        timeout = self.params.oscillation_timeout
        if timeout > 0.0 and now >= self._last_progress + timeout - EPSILON_S:
            mission.error = NoProgressError(
                f"the robot came no further than {self.params.oscillation_distance:g} m for {timeout:g} s",
                oscillation_timeout=timeout,
                oscillation_distance=self.params.oscillation_distance,
                pose=self._pose,
            )
            mission.tally.failed(mission.error, now)
            self._emit(now, "control_failed", mission.error.message, mission.error.as_dict())
            self._apply(NavEvent.OSCILLATING, now)
            return
        if error is None and inputs is not None:
            try:
                if self._speed_masks.heed(now, slowed=bool(self._followed)):
                    limit = self._speed_masks.limit
                    text = "no speed limit any more" if limit is None else f"speed limit {limit:.2f} m/s"
                    self._emit(now, "info", f"{text}, says the speed mask", {"max_vel_trans": limit})
                local = guards.compute_command(self.local_planner, inputs)
                self._local_plan = self.turn.local_plan = local
                mission.tally.commands += 1
                self._send(local.command, now)
                self._apply(NavEvent.COMMAND_FOUND, now)
                return
            except NavError as exc:
                error = exc
        assert error is not None
        tally = mission.tally
        tally.failed_commands += 1
        tally.last_control = error
        tally.failed(error, now)
        self._emit(now, "control_failed", error.message, error.as_dict())
        patience = self.params.controller_patience
        exhausted = now >= self._last_valid_control + patience - EPSILON_S
        self._apply(NavEvent.CONTROL_EXHAUSTED if exhausted else NavEvent.COMMAND_FAILED, now)

    def local_state(self, now: float) -> RobotState:
        """Pose in the local costmap's frame, velocity as the robot says; raises NavError."""
        try:
            pose = self.local_costmap.robot_pose(now)
            state = self.robot.state()
        except NavError:
            raise
        except Exception as exc:
            raise guards.internal("the robot", exc) from exc
        if not pose.is_finite() or not state.velocity.is_finite():
            raise InternalError(
                f"the robot's pose {tuple(pose)} or velocity {tuple(state.velocity)} is not finite",
                pose=pose,
                velocity=state.velocity,
            )
        return RobotState(pose, state.velocity, state.stamp, self.local_costmap.frame)

    def _inputs(self, plan: Plan, now: float) -> ControlInput:
        costmap = self.local_costmap
        state = self.local_state(now)
        frame = plan.path.frame
        transform = Transform2D()
        if frame != costmap.frame:
            try:
                transform = self.robot.frames.lookup(costmap.frame, frame)
            except NavError:
                raise
            except Exception as exc:
                raise guards.internal("the robot's frames", exc) from exc
        return ControlInput(state, costmap.master, costmap.footprint, transform)

    # --- planning -----------------------------------------------------------------------------------------------------

    def _ask_planner(self, now: float) -> None:
        if self._state.mode is Mode.CLEARING or self._planning.is_busy:
            return
        if self._wake_planner:
            self._replan.restart(now)
        elif not (self._planner_on and self._replan.is_due(now)):
            return
        self._wake_planner = False
        self._replan.advance(now)
        mission = self._mission
        assert mission is not None
        try:
            if mission.pose is None:
                error = self._locate_goal(mission, now)
                if error is not None:
                    raise error
            assert mission.pose is not None
            start = self.global_costmap.robot_pose(now)
            if not start.is_finite():
                raise InternalError(f"the robot's pose {tuple(start)} is not finite", pose=start)
        except Exception as exc:
            problem = exc if isinstance(exc, NavError) else guards.internal("the robot's frames", exc)
            self._hear(PlanAnswer(mission.handle.id, now, None, problem), now)
            return
        costmap = self.global_costmap
        self._planning.request(
            self.global_planner, costmap.master, start, mission.pose, costmap.footprint, mission.handle.id, now
        )
        answer = self._planning.poll(now)
        if answer is not None:
            self._hear(answer, now)

    def _hear(self, answer: PlanAnswer, now: float) -> None:
        """Takes in what the planner said; a plan for a goal that is no more is not one."""
        mission = self._mission
        if mission is None or answer.goal_id != mission.handle.id or not self._active():
            return
        if answer.plan is not None and answer.plan.path.frame == self.global_costmap.frame:
            self._found_plan(mission, answer.plan, now)
        elif answer.error is not None:
            self._failed_plan(mission, answer.error, now)

    def _found_plan(self, mission: _Mission, plan: Plan, now: float) -> None:
        mission.tally.plans += 1
        if self._state.mode is not Mode.CLEARING:
            self._plan = self._new_plan = plan
            self.turn.plan = plan
        self._wake_planner = False  # whoever asked while the planner was busy has his plan
        if self.params.planner_frequency <= 0.0:
            self._planner_on = False
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

    def _failed_plan(self, mission: _Mission, error: NavError, now: float) -> None:
        tally = mission.tally
        tally.failed_plans += 1
        tally.last_planning = error
        tally.failed(error, now)
        self._emit(now, "plan_failed", error.message, error.as_dict())
        if self._state.mode is not Mode.PLANNING:
            self._apply(NavEvent.PLAN_FAILED, now)
            return
        self._retries += 1
        limit = self.params.max_planning_retries
        # at the deadline itself patience is over: in C++ the answer always comes a few ms after the cycle that asked
        late = now >= self._last_valid_plan + self.params.planner_patience - EPSILON_S
        exhausted = late or 0 <= limit < self._retries
        self._apply(NavEvent.PLANNING_EXHAUSTED if exhausted else NavEvent.PLAN_FAILED, now)

    def _check_slow_planner(self, now: float) -> None:
        """C++ waits for ever for a planner that does not return. Here patience ends; a late plan is welcome all the same."""
        mission = self._mission
        waited = now - self._last_valid_plan
        if mission is None or not self._planning.is_busy or waited < self.params.planner_patience - EPSILON_S:
            return
        error = PlanningTimeoutError(
            f"the global planner has not answered for {waited:.1f} s (planner_patience "
            f"{self.params.planner_patience:g} s)",
            waited_s=waited,
        )
        self._failed_plan(mission, error, now)

    # --- recovery -----------------------------------------------------------------------------------------------------

    def _clear(self, now: float) -> None:
        mission = self._mission
        assert mission is not None
        index = self._state.recovery_index
        left = self.params.recovery_behavior_enabled and index < len(self.recoveries)
        if left and mission.rounds < MAX_RECOVERY_ROUNDS * len(self.recoveries):
            self._apply(NavEvent.RECOVERY_BEGINS, now)
            return
        log = {
            Trigger.PLANNING_R: texts.LOG_NO_PLAN,
            Trigger.CONTROLLING_R: texts.LOG_NO_CONTROL,
            Trigger.OSCILLATION_R: texts.LOG_OSCILLATING,
        }[self._state.trigger]
        self._warn(now, log)
        self._apply(NavEvent.RECOVERIES_EXHAUSTED, now)

    def _start_recovery(self, now: float) -> None:
        mission = self._mission
        assert mission is not None
        recovery = self._recovery = self.recoveries[self._state.recovery_index]
        self._recovery_began = now
        self._recovery_steps = Schedule(recovery.frequency or self.params.controller_frequency, now)
        self._recovery_polls = Schedule(self.params.controller_frequency, now)
        self._recovery_polls.advance(now)
        self._recovery_steps.advance(now)
        mission.tally.recoveries.append(recovery.name)
        mission.rounds += 1
        try:
            recovery.start(self._context, now)
        except Exception as exc:
            error = exc if isinstance(exc, NavError) else guards.internal(recovery.name, exc)
            self._end_recovery(recovery, RecoveryStatus.FAILED, error.message, error.as_dict(), error, now)
            return
        self._step_recovery(recovery, now)

    def _recover(self, now: float) -> None:
        """A turn of a recovery that runs: unlike in C++, cancels, new goals and silent sensors are seen (parity 22)."""
        polled, stepped = self._recovery_polls.is_due(now), self._recovery_steps.is_due(now)
        if polled:
            self._recovery_polls.advance(now)
        if stepped:
            self._recovery_steps.advance(now)
        if not (polled or stepped):
            return
        if self._preempted(now) or self._recovery is None or self._is_stale(now):
            return
        recovery = self._recovery
        if now - self._recovery_began >= self.recovery_time_limit_s:
            error = RecoveryTimeoutError(
                f"{recovery.name} did not end within {self.recovery_time_limit_s:g} s", recovery=recovery.name
            )
            self._end_recovery(recovery, RecoveryStatus.FAILED, error.message, error.as_dict(), error, now)
        elif stepped:
            self._step_recovery(recovery, now)

    def _step_recovery(self, recovery: RecoveryBehavior, now: float) -> None:
        first = now == self._recovery_began
        error: NavError | None = None
        try:
            done = guards.recovery_step(recovery, self.local_state(now), now)
        except NavError as exc:
            error = exc
            self._end_recovery(recovery, RecoveryStatus.FAILED, exc.message, exc.as_dict(), exc, now)
            return
        if done.status is RecoveryStatus.RUNNING:
            self._send(done.twist, now)
            if first or done.text:
                self._tell_recovery(recovery, done.status, done.text or f"{recovery.name} begins", done.data, now)
            return
        if done.status is RecoveryStatus.FAILED:
            error = NavError(done.text or f"{recovery.name} failed", recovery=recovery.name, **done.data)
        self._end_recovery(recovery, done.status, done.text, done.data, error, now)

    def _end_recovery(
        self,
        recovery: RecoveryBehavior,
        status: RecoveryStatus,
        text: str,
        data: dict[str, Any],
        error: NavError | None,
        now: float,
    ) -> None:
        if error is not None and self._mission is not None:
            self._mission.tally.failed(error, now)
        self._tell_recovery(recovery, status, text or f"{recovery.name} ends", data, now)
        if recovery not in self._followed:
            self._followed.append(recovery)
        lasted = now > self._recovery_began
        self._apply(NavEvent.RECOVERY_ENDED, now)
        if lasted:
            # as ros::Rate after a cycle that took long: the next cycle is now
            self._control.restart(self._recovery_began)
            self._control.advance(self._recovery_began)
            self._control.resume(now)

    def _tell_recovery(
        self, recovery: RecoveryBehavior, status: RecoveryStatus, text: str, data: dict[str, Any], now: float
    ) -> None:
        if not self.listeners:
            return
        about: dict[str, Any] = {
            "name": recovery.name,
            "index": self._state.recovery_index,
            "total": len(self.recoveries),
            "status": status.value,
            "trigger": self._state.trigger.name,
        }
        self._emit(now, "recovery", text, {**data, **about})

    # --- carrying out -------------------------------------------------------------------------------------------------

    def _end_with(self, event: NavEvent, error: NavError, now: float) -> None:
        if self._mission is not None:
            self._mission.error = error
        self._apply(event, now)

    def _apply(self, event: NavEvent, now: float) -> None:
        """Steps the state machine and does what it says."""
        before = self._state
        try:
            state, row = step(before, event)
        except InternalError as exc:
            if self._mission is not None:
                self._mission.error = exc
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
            case Action.STOP:
                self._send(STANDING, now)
            case Action.STOP_IF_MOVING:
                if self._command != STANDING:
                    self._send(STANDING, now)
            case Action.WAKE_PLANNER:
                self._wake_planner = self._planner_on = True
            case Action.STOP_PLANNER:
                self._wake_planner = self._planner_on = False
            case Action.RESET_TIMERS:
                self._last_valid_plan = self._last_valid_control = now
                self._retries = 0
            case Action.RESET_PLAN_PATIENCE:
                self._last_valid_plan = now
                self._retries = 0
            case Action.RESET_CONTROL_PATIENCE:
                self._last_valid_control = now
            case Action.RESET_OSCILLATION:
                self._last_progress = now
            case Action.START_RECOVERY:
                self._start_recovery(now)
            case Action.DROP_RECOVERY:
                self._recovery = None
            case Action.START_COSTMAPS:
                if not self._costmaps_on:
                    self._costmaps_on = True
                    self._global_update.restart(now)
                    self._local_update.restart(now)
            case Action.STOP_COSTMAPS:
                self._costmaps_on = not self.params.shutdown_costmaps

    def _send(self, twist: Twist2D, now: float) -> None:
        self._command = self.turn.command = twist
        self._command_time = now
        try:
            self.robot.command(twist)
        except Exception as exc:
            if self._driver_error is None:
                error = exc if isinstance(exc, NavError) else guards.internal("the robot", exc)
                self._driver_error = error
                self._warn(now, f"the robot does not take the command {tuple(twist)}: {error.message}", error)

    def _finish(self, outcome: Outcome, now: float) -> None:
        """The goal at hand ends."""
        mission = self._mission
        if mission is None:
            return
        self._mission = None
        self._stale_since = None
        self._plan = self._new_plan = None
        text = outcome.value
        if outcome is Outcome.REACHED:
            self.server.set_succeeded(now, text, self._result(mission, GoalStatus.SUCCEEDED, text, None, now))
            return
        error = self._reason(outcome, mission, now)
        if outcome is Outcome.CANCELED:
            self.server.set_preempted(now, text, self._result(mission, GoalStatus.PREEMPTED, text, error, now))
            return
        if outcome is Outcome.BAD_QUATERNION and not mission.handle.goal.pose.is_finite():
            text = texts.BAD_QUATERNION if not mission.handle.goal.has_valid_orientation else texts.BAD_POSITION
        self.server.set_aborted(now, text, self._result(mission, GoalStatus.ABORTED, text, error, now))

    def _reason(self, outcome: Outcome, mission: _Mission, now: float) -> NavError:
        """The error behind an outcome."""
        tally = mission.tally
        age = self._age(mission, now)
        match outcome:
            case Outcome.CANCELED:
                return GoalCanceledError(f"the goal was cancelled after {age:.1f} s")
            case Outcome.NO_PLAN:
                return tally.last_planning or PlanningError("the global planner found no plan")
            case Outcome.NO_CONTROL:
                return tally.last_control or NavError("the local planner found no command")
            case Outcome.KILLED:
                return ShutdownError("the goal manager was shut down")
            case _:
                return mission.error or tally.last or InternalError("nobody said why; please report this")

    def _result(
        self, mission: _Mission, status: GoalStatus, text: str, error: NavError | None, now: float
    ) -> GoalResult:
        tally = mission.tally
        data = tally.as_data()
        message = ""
        code, name = 0, "NONE"
        if error is not None:
            code, name = error.code, error.name
            data["error"] = error.as_dict()
            counted = tally.by_name.get(name, 0)
            message = error.message
            if counted > 1:
                message += f" ({counted} times"
                message += f"; recoveries tried: {', '.join(tally.recoveries)})" if tally.recoveries else ")"
        return GoalResult(
            status,
            text,
            code,
            name,
            message,
            data,
            tuple(tally.recoveries),
            mission.handle.goal.stamp,
            mission.handle.accepted_at,
            now,
        )

    @staticmethod
    def _age(mission: _Mission, now: float) -> float:
        begun = mission.handle.accepted_at
        return now - begun if begun is not None else 0.0

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
        if self._active():
            raise BusyError(texts.LOG_BUSY)
        if self._planning.is_using(self.global_planner):
            raise BusyError("the global planner still works on a plan that nobody waits for; try again in a while")
        if not math.isfinite(tolerance) or tolerance < 0.0:
            raise InputError(f"tolerance is a distance in metres, not {tolerance}", tolerance=tolerance)
        costmap = self.global_costmap
        master = costmap.master
        robot: Pose2D | None = None
        try:
            robot = costmap.robot_pose(self._now if self._ticked else None)
        except FrameError:
            if start is None:
                raise
        if start is None:
            assert robot is not None
            start = robot
        if self.params.make_plan_clear_costmap and robot is not None:
            radius = self.params.clearing_radius
            half = costmap.footprint.circumscribed_radius if radius is None else radius
            window = master.geometry.window_of(Bounds(robot.x, robot.y, robot.x, robot.y).grown(half))
            master = master.copy()
            master.data[window.slices] = 0
        try:
            return guards.make_plan(self.global_planner, master, start, goal, costmap.footprint)
        except PlanningError as exc:
            refused = exc
        for near, offset in rings(goal, master.geometry.resolution, tolerance):
            try:
                plan = guards.make_plan(self.global_planner, master, start, near, costmap.footprint)
            except PlanningError:
                continue
            path = plan.path
            if self.params.make_plan_add_unreachable_goal:
                path = Path(np.vstack((path.poses, [tuple(goal)])), path.frame)
            note = f"the goal itself cannot be reached ({refused.name}); planned to {offset:.2f} m from it"
            return Plan(path, plan.cost, near, offset, plan.cells_expanded, plan.potential, (*plan.notes, note))
        raise refused

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

    def _distance_remaining(self, mission: _Mission) -> float:
        pose = self._pose
        if pose is None:
            return math.inf
        if self._plan is None:
            return pose.distance_to(mission.pose) if mission.pose is not None else math.inf
        points = self._plan.path.poses[:, :2]
        away = np.hypot(points[:, 0] - pose.x, points[:, 1] - pose.y)
        nearest = int(np.argmin(away))
        rest = np.diff(points[nearest:], axis=0)
        return float(away[nearest] + np.hypot(rest[:, 0], rest[:, 1]).sum())


def rings(goal: Pose2D, resolution: float, tolerance: float) -> list[tuple[Pose2D, float]]:
    """Poses on growing square rings around `goal`, and how far each is (m), in move_base's order (planService).

    The step is three cells, or `tolerance` (m) where that is smaller.
    """
    if tolerance <= 0.0:
        return []
    increment = min(3.0 * resolution, tolerance)
    count = int(tolerance / increment + 1e-9)
    found: list[tuple[Pose2D, float]] = []
    for ring in range(1, count + 1):
        for iy in range(ring + 1):
            for ix in range(ring + 1):
                if ix < ring and iy < ring:
                    continue
                for sign_y in (-1.0, 1.0) if iy else (1.0,):
                    for sign_x in (-1.0, 1.0) if ix else (1.0,):
                        dx, dy = sign_x * ix * increment, sign_y * iy * increment
                        found.append((Pose2D(goal.x + dx, goal.y + dy, goal.yaw), math.hypot(dx, dy)))
    return found


def _update_frequency(costmap: CostmapServer, given: float | None) -> float:
    if given is not None:
        return given
    return float(getattr(getattr(costmap, "params", None), "update_frequency", DEFAULT_UPDATE_FREQUENCY))


def _said(problem: Exception) -> str:
    return str(problem) or type(problem).__name__
