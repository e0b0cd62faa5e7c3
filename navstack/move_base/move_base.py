"""The goal manager: accepts goals, plans, drives and recovers, and ends every goal with a reason.

`MoveBase.tick` is one update cycle. The parts know nothing of each other and of `MoveBase`: they return what they find, and
`MoveBase` takes the transitions of `states.py`. A plan is passed to the local planner in the control cycle after its request,
as in C++, where it arrives from another thread a few milliseconds later. Nothing here sleeps, starts a thread or reads a
clock.

Source: move_base/src/move_base.cpp.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Final

from navstack.behaviors import BehaviorEnd
from navstack.core import (
    InputError,
    InternalError,
    Listener,
    NavError,
    PlanningTimeoutError,
    Pose2D,
    RobotState,
    Twist2D,
    turn_note,
)
from navstack.move_base import planning as plans
from navstack.move_base import states
from navstack.move_base.active_goal import ActiveGoal, Feedback
from navstack.move_base.checks import (
    LostCheck,
    OscillationChecker,
    Progress,
    StaleSensorCheck,
    StallCheck,
    check_progress,
)
from navstack.move_base.control import ControlInputs, SpeedLimiter
from navstack.move_base.costmaps import CostmapUpdater, transform_tolerance
from navstack.move_base.errors import BusyError, GoalReplacedError, GoalTimeLimitError, NoProgressError
from navstack.move_base.events import EventPublisher, TickResult
from navstack.move_base.goals import REPLACED, GoalHandle, GoalStatus, Quaternion, SimpleActionServer, make_goal
from navstack.move_base.motions import ACTIVITY, MotionRunner
from navstack.move_base.output import ZERO, CommandOutput
from navstack.move_base.planning import InlinePlanning, PlanAnswer, Planning, PlanRequest, PlanSchedule
from navstack.move_base.plugin_calls import (
    brake,
    call,
    check_plugin,
    checked_flag,
    checked_pose,
    compute_command,
    localization_status,
    lookup_transform,
)
from navstack.move_base.recovery import MAX_ROUNDS, Recoveries
from navstack.move_base.schedule import EPSILON_S, SCAN_MARGIN_S, Schedule
from navstack.move_base.states import Action, Mode, NavEvent, NavState, Outcome, Transition, Trigger
from navstack.parameters import MoveBaseParams
from navstack.plugins import (
    Behavior,
    BehaviorContext,
    BehaviorStatus,
    CommandLimits,
    ControlInput,
    CostmapServer,
    GlobalPlanner,
    LocalPlan,
    LocalPlanner,
    Plan,
    Robot,
    limits_of,
)
from navstack.safety import CommandChain

LONGEST_BRAKING_S: Final = 5.0
"""A local planner that still brakes then is stopped (s)."""

_EXHAUSTED: Final = {
    Trigger.PLANNING_R: states.LOG_NO_PLAN,
    Trigger.CONTROLLING_R: states.LOG_NO_CONTROL,
    Trigger.OSCILLATION_R: states.LOG_OSCILLATING,
    Trigger.LOST_R: states.LOG_LOST,
}


class MoveBase:
    """Drives a robot to one goal at a time."""

    def __init__(
        self,
        params: MoveBaseParams,
        *,
        robot: Robot,
        global_costmap: CostmapServer,
        local_costmap: CostmapServer,
        global_planner: GlobalPlanner,
        local_planner: LocalPlanner,
        recoveries: Sequence[Behavior] = (),
        listeners: Sequence[Listener] = (),
        planning: Planning | None = None,
        global_update_frequency: float | None = None,
        local_update_frequency: float | None = None,
        recovery_time_limit_s: float = 120.0,
        goal_time_limit_s: float = math.inf,
        stall_timeout_s: float = 0.0,
        stopwatch: Callable[[], float] | None = None,
    ) -> None:
        """Create a goal manager; `planning` defaults to `InlinePlanning` without delay.

        The update frequencies (Hz) default to the costmaps' parameters. A recovery behavior that runs longer than
        `recovery_time_limit_s` fails; a goal that runs longer than `goal_time_limit_s` after its acceptance is aborted.
        ROS differs: C++ has no such limit; without one, a goal can last forever if oscillation_timeout is 0. A robot that does
        not move for `stall_timeout_s` although it is commanded to has no valid control (0: no check).

        With a `stopwatch` (a function that returns seconds, such as `time.perf_counter`), `last_tick` has the durations of
        planning and control; nothing else depends on it.

        Raises a ParameterError if the parameters of a recovery behavior do not fit the costmaps.
        """
        self.robot = robot
        self.global_costmap = global_costmap
        self.local_costmap = local_costmap
        self.goal_time_limit_s = goal_time_limit_s
        """Time limit of goals without one of their own (s from acceptance); inf for none."""
        self.stall_timeout_s = stall_timeout_s
        """Longest time (s) that the robot may stand still although it is commanded to move; 0 for no limit."""
        self._params = params
        self._global_planner = global_planner
        self._local_planner = local_planner
        self._planning = planning or InlinePlanning()
        self._stopwatch = stopwatch

        self._now = 0.0
        self._has_ticked = False
        self._is_shut_down = False
        self._goal_count = 0
        self._state = NavState()
        self._goal: ActiveGoal | None = None
        """The active goal; None in the mode IDLE."""
        self._local_plan: LocalPlan | None = None
        self._pose: Pose2D | None = None
        """The robot in the global costmap's frame in the last control cycle; None if unknown."""

        events = self._events = EventPublisher(listeners)
        self.listeners = events.listeners
        self.server = SimpleActionServer(self._publish_status)
        self._costmaps = CostmapUpdater(
            robot,
            global_costmap,
            local_costmap,
            events,
            enabled=not params.shutdown_costmaps,
            global_frequency=global_update_frequency,
            local_frequency=local_update_frequency,
        )
        self._inputs = ControlInputs(robot, global_costmap, local_costmap, local_planner)
        self._inputs.settle_s = 0.5 * params.controller_patience
        self._output = CommandOutput(robot, global_costmap, local_costmap, events)
        self._sensors = StaleSensorCheck(local_costmap, self._costmaps, self._inputs, events)
        self.lost = LostCheck(robot, events)
        """What happens while the robot does not know where it is."""
        self._progress = OscillationChecker(params.oscillation_distance)
        self._progress_checker = params.make_progress_checker()
        """The progress checker of the parameters, in addition to oscillation_timeout; None without one."""
        self._stall = StallCheck()
        self._plans = PlanSchedule(params)
        self._cycles = Schedule(params.controller_frequency)
        self._limiter = SpeedLimiter((local_costmap, global_costmap), local_planner)
        self._command_limits = CommandLimits(local_planner)
        context = self._context_of(local_planner, params.controller_frequency)
        self._recoveries = Recoveries(recoveries, context, events, recovery_time_limit_s)
        self.motions = MotionRunner(
            robot,
            params,
            context,
            costmaps=self._costmaps,
            inputs=self._inputs,
            output=self._output,
            events=events,
            is_idle=lambda: self._goal is None and self.server.next is None,
            running_recovery=lambda: self._recoveries.running,
        )
        """Motions and commands from outside, while no goal is active."""
        self._actions: dict[Action, Callable[[float], None]] = {
            Action.STOP: self._output.stop,
            Action.STOP_IF_MOVING: self._output.stop_if_moving,
            Action.WAKE_PLANNER: self._plans.wake,
            Action.STOP_PLANNER: self._plans.stop,
            Action.RESET_TIMERS: self._reset_timers,
            Action.RESET_PLAN_PATIENCE: self._plans.reset_patience,
            Action.RESET_CONTROL_PATIENCE: self._reset_control_patience,
            Action.RESET_OSCILLATION: self._reset_oscillation,
            Action.START_RECOVERY: self._start_recovery,
            Action.DROP_RECOVERY: self._drop_recovery,
            Action.START_COSTMAPS: self._start_costmaps,
            Action.STOP_COSTMAPS: self._stop_costmaps,
        }

    # --- update cycle -------------------------------------------------------------------------------------------------

    def next_due(self, now: float) -> float:
        """Return the next time (s) at which `tick` has work, at least `now`; inf for never."""
        if not self._has_ticked:
            return now
        due = min(self._costmaps.due, self._output.due)
        if self._goal is None:
            return now if self.server.next is not None else max(now, min(due, self.motions.due))
        recovering = self._recoveries.running is not None
        due = min(due, self._recoveries.due if recovering else self._cycles.due, self._planning.due)
        if self._state.mode is not Mode.CLEARING and not self._planning.is_busy:
            due = min(due, self._plans.due)
        return max(now, due)

    def tick(self, now: float) -> None:
        """Update sensors, update the costmaps that are due, control or recover, and replan if due, at `now` (s).

        Call it at `next_due`; additional calls are allowed. Raises InputError if the time runs backwards. Failures of
        plugins, costmaps and the robot end in the result of the goal.
        """
        tick = self._start_tick(now)
        now = tick.time
        self._costmaps.observe(tick)
        if self.lost.observe(now):
            self._forget_obstacles(now)
        if self._goal is None and self.server.next is not None:
            self._accept_waiting_goal(now)
        self._costmaps.update(tick)
        if self._goal is not None:
            answer = self._planning.poll(now)
            if answer is not None:
                self._take_answer(answer, now)
            self._recover_or_control(now)
            self._request_plan_if_due(now)
        else:
            self.motions.run(now)
        if self._output.chain is not None:
            self._output.finish()
        if self._output.error is not None and self._goal is not None:
            self._apply(NavEvent.DRIVER_FAILED, now, self._output.error)

    def follow_scans(self, now: float) -> None:
        """Let the cycles follow right after scans, one of which arrived at `now` (s); the control period hardly changes."""
        self._cycles.approach(now + 2.0 * SCAN_MARGIN_S)
        self._costmaps.approach(now + SCAN_MARGIN_S, self._cycles.due - SCAN_MARGIN_S)

    def shutdown(self) -> None:
        """End every goal ("node has been killed") and stop the robot. Later goals end at once."""
        self._is_shut_down = True
        self.motions.cancel()
        self._apply(NavEvent.SHUTDOWN, self._now)
        if self.server.next is not None:
            self._accept_waiting_goal(self._now)
        self._output.halt(self._now)

    def _start_tick(self, now: float) -> TickResult:
        if not now >= self._now - EPSILON_S or not math.isfinite(now):
            message = f"time must not run backwards: tick({now}) after tick({self._now})"
            raise InputError(message, now=now, last=self._now)
        now = self._now = max(now, self._now)
        if not self._has_ticked:
            self._has_ticked = True
            self._costmaps.restart(now)
        tick = TickResult(now)
        self._output.begin(tick)
        self._inputs.refresh()
        return tick

    def _recover_or_control(self, now: float) -> None:
        runner = self._recoveries.runner
        if runner.running is not None:
            self._run_recovery(runner.running, now)
        if runner.running is None and now >= self._cycles.due - EPSILON_S and self._goal is not None:
            self._run_control_cycle(now)

    def _forget_obstacles(self, now: float) -> None:
        """Forget the obstacles that were marked while the robot was lost, and plan again."""
        costmaps = [self.global_costmap]
        if self.local_costmap.frame == self.global_costmap.frame:
            costmaps.append(self.local_costmap)
        for costmap in costmaps:
            try:
                call(costmap, costmap.reset)
            except NavError as exc:
                self._events.warn(now, f"{costmap.name} could not be reset: {exc.message}", exc)
        self._costmaps.restart(now)  # a plan must not rest on an empty costmap
        if self._goal is not None:
            self._apply(NavEvent.FOUND, now)

    # --- transitions --------------------------------------------------------------------------------------------------

    def _apply(self, event: NavEvent, now: float, error: NavError | None = None) -> None:
        """Take the transition of an event at `now` (s), execute its actions and end the goal if the transition does.

        `error` is the reason for the event. An event that is illegal in the current state ends the goal.
        """
        if error is not None and self._goal is not None:
            self._goal.error = error
        before = self._state
        try:
            state, row = states.step(before, event)
        except InternalError as exc:
            if self._goal is not None:
                self._goal.error = exc
            state = NavState()
            row = Transition(before.mode, event, Mode.IDLE, states.ILLEGAL_ACTIONS, Outcome.BAD_STATE)
        self._state = state
        if state.mode is not before.mode and self._events.hears("state"):
            self._events.publish(now, "state", *before.change(state, event))
        for action in row.actions:
            self._actions[action](now)
        if row.outcome is not None:
            self._finish_goal(row.outcome, now)

    def _reset_timers(self, now: float) -> None:
        self._plans.reset_patience(now)
        self._reset_control_patience(now)

    def _reset_control_patience(self, now: float) -> None:
        if self._goal is not None:
            self._goal.last_valid_control = now

    def _reset_oscillation(self, now: float) -> None:
        if self._goal is not None:
            self._goal.last_progress = now
            self._stall.reset()
        checker = self._progress_checker
        if checker is not None:
            try:
                call(checker, checker.reset)
            except NavError as exc:
                self._events.warn(now, exc.message, exc)

    def _drop_recovery(self, now: float) -> None:
        self._recoveries.runner.drop(now)

    def _start_costmaps(self, now: float) -> None:
        self._costmaps.enable(True, now)

    def _stop_costmaps(self, now: float) -> None:
        self._costmaps.enable(not self._params.shutdown_costmaps, now)

    def _publish_status(self, handle: GoalHandle, now: float) -> None:
        if self.listeners:
            self._events.publish(now, "status", *handle.announcement())

    # --- the active goal ----------------------------------------------------------------------------------------------

    def _accept_waiting_goal(self, now: float) -> None:
        self.motions.cancel()
        goal = self._accept_goal(now)
        if self._is_shut_down:
            self._apply(NavEvent.GOAL_ACCEPTED, now)
            self._apply(NavEvent.SHUTDOWN, now)
        elif goal.error is not None:
            self._apply(NavEvent.GOAL_INVALID, now)
        else:
            self._cycles.restart(now)
            self._output.error = None
            self._costmaps.retry_failed(now)
            self._inputs.start_goal()
            self._apply(NavEvent.GOAL_ACCEPTED, now)

    def _accept_goal(self, now: float) -> ActiveGoal:
        """Make the waiting goal the active goal. An invalid goal has an error, which the caller must apply."""
        handle = self.server.accept(now)
        sent = handle.goal
        limit = self.goal_time_limit_s if sent.time_limit_s is None else sent.time_limit_s
        goal = self._goal = ActiveGoal(handle, now + limit)
        self._progress = OscillationChecker(self._params.oscillation_distance)
        self._stall = StallCheck()
        self._local_plan = None
        self._planning.abandon()
        if self.listeners:
            self._events.publish(now, "goal", *sent.announcement())
        goal.error = sent.problem()
        if goal.error is None:
            goal.frame = self.global_costmap.frame
            with contextlib.suppress(NavError):  # the plan request repeats the lookup
                self._locate_goal(goal, now)
        return goal

    def _locate_goal(self, goal: ActiveGoal, now: float) -> Pose2D:
        """Transform the goal into the global costmap's frame.

        Raises NavError if the transform is not known, or older than the costmap's transform_tolerance.
        """
        sent, target = goal.handle.goal, self.global_costmap.frame
        tolerance = transform_tolerance(self.global_costmap)
        pose = goal.pose = lookup_transform(self.robot, target, sent.frame, now, tolerance).apply(sent.pose)
        if sent.frame != target:
            text = f'the goal is at ({pose.x:.3f}, {pose.y:.3f}) in "{target}"'
            self._events.info(now, text, goal_pose=list(pose))
        return pose

    def _must_end(self, now: float) -> bool:
        """Apply cancel requests, new goals and the time limit; return True if there is no active goal afterwards."""
        if self.server.preempt_requested and self._is_preempted(now):
            return True
        goal = self._goal
        if goal is None or now < goal.deadline - EPSILON_S:
            return False
        # ROS differs: C++ has no time limit
        limit = goal.deadline - (goal.handle.accepted_at or 0.0)
        text = f"the goal was not reached within its time limit of {limit:g} s"
        self._apply(NavEvent.TIMED_OUT, now, GoalTimeLimitError(text, time_limit_s=limit, pose=self._pose))
        return True

    def _is_preempted(self, now: float) -> bool:
        """Cancel or replace the active goal, as C++ does at the top of its loop; return True if it has no successor."""
        server, goal = self.server, self._goal
        if server.next is None:
            self._apply(NavEvent.CANCELED, now)
            return True
        if goal is not None:
            error = GoalReplacedError(f"the goal was replaced by a new goal after {goal.age(now):.1f} s")
            server.set_preempted(now, REPLACED, goal.result(GoalStatus.PREEMPTED, REPLACED, error, now))
        if self._accept_goal(now).error is not None:
            self._apply(NavEvent.GOAL_INVALID, now)
            return True
        self._apply(NavEvent.GOAL_REPLACED, now)
        return False

    def _finish_goal(self, outcome: Outcome, now: float) -> None:
        goal, server = self._goal, self.server
        if goal is None:
            return
        self._goal = None
        text = outcome.value
        if outcome is Outcome.REACHED:
            server.set_succeeded(now, text, goal.result(GoalStatus.SUCCEEDED, text, None, now))
            return
        error = goal.reason(outcome, now)
        if outcome is Outcome.CANCELED:
            server.set_preempted(now, text, goal.result(GoalStatus.PREEMPTED, text, error, now))
            return
        if outcome is Outcome.BAD_QUATERNION and goal.handle.goal.has_valid_orientation:
            text = states.BAD_POSITION
        server.set_aborted(now, text, goal.result(GoalStatus.ABORTED, text, error, now))

    # --- planning -----------------------------------------------------------------------------------------------------

    def _request_plan_if_due(self, now: float) -> None:
        """Request a plan if one is due. An answer that is available at once is applied in this tick."""
        goal = self._goal
        if goal is None or self._state.mode is Mode.CLEARING:
            return
        planning = self._planning
        if planning.is_busy or not self._plans.take_request(now):
            return
        try:
            request = self._plan_request(goal, now)
        except NavError as exc:
            self._take_answer(PlanAnswer(goal.handle.id, now, None, exc), now)
            return
        stopwatch = self._stopwatch
        if stopwatch is None:
            planning.request(request)
        else:
            began = stopwatch()
            planning.request(request)
            self._output.tick.planning_s = stopwatch() - began
        answer = planning.poll(now)
        if answer is not None:
            self._take_answer(answer, now)

    def _plan_request(self, goal: ActiveGoal, now: float) -> PlanRequest:
        if self._costmaps.global_error is not None:
            # ROS differs: it plans on a costmap that could not be updated, without its static map if need be
            raise self._costmaps.global_error
        pose = self._locate_goal(goal, now) if goal.pose is None else goal.pose
        costmap = self.global_costmap
        start = call(costmap, costmap.robot_pose, now, check=checked_pose)
        return PlanRequest(self._global_planner, costmap.master, start, pose, costmap.footprint, goal.handle.id, now)

    def _take_answer(self, answer: PlanAnswer, now: float) -> None:
        """Apply an answer, unless it is for another goal or in the global costmap's previous frame."""
        goal, costmap = self._goal, self.global_costmap
        if goal is None or answer.goal_id != goal.handle.id:
            return
        if answer.plan is not None and answer.plan.path.frame == costmap.frame:
            self._take_plan(goal, answer.plan, now)
        elif answer.error is not None:
            self._fail_plan(goal, plans.add_layer(costmap, answer.error), now)

    def _take_plan(self, goal: ActiveGoal, plan: Plan, now: float) -> None:
        goal.statistics.plans += 1
        with contextlib.suppress(NavError):  # the control cycle repeats the request for the limits
            note = turn_note(plan.path, limits_of(self._local_planner).min_turning_radius)
            if note is not None:
                plan = replace(plan, notes=(*plan.notes, note))
        if self._state.mode is not Mode.CLEARING:
            goal.plan = goal.new_plan = self._output.tick.plan = plan
        self._plans.succeed()
        self._events.plan(now, plan)
        self._apply(NavEvent.PLAN_FOUND, now)

    def _fail_plan(self, goal: ActiveGoal, error: NavError, now: float) -> None:
        goal.statistics.add_failed_plan(error, now)
        self._events.failure(now, "plan_failed", error)
        exhausted = self._state.mode is Mode.PLANNING and self._plans.fail(now)
        self._apply(NavEvent.PLANNING_EXHAUSTED if exhausted else NavEvent.PLAN_FAILED, now)

    def _check_planning_time(self, goal: ActiveGoal, now: float) -> None:
        """Report a planner that has not answered within planner_patience.

        ROS differs: C++ waits without a limit. A late plan is still used.
        """
        patience, waited = self._params.planner_patience, self._plans.waited(now)
        if self._planning.is_busy and waited >= patience - EPSILON_S:
            text = f"the global planner has not answered for {waited:.1f} s (planner_patience {patience:g} s)"
            self._fail_plan(goal, PlanningTimeoutError(text, waited_s=waited), now)

    # --- control ------------------------------------------------------------------------------------------------------

    def _run_control_cycle(self, now: float) -> None:
        """Run a control cycle: check the goal, the pose and the sensors, pass a new plan on, then control or recover."""
        self._cycles.advance(now)
        server = self.server
        if server.preempt_requested and server.next is None and self._brake(now):
            return
        goal = self._goal
        if goal is None or server.preempt_requested or now >= goal.deadline - EPSILON_S:
            if self._must_end(now):
                return
            goal = self._goal
        assert goal is not None
        if self.global_costmap.frame != goal.frame:
            self._change_frame(goal, now)
        if self._track(goal, now) and self._recoveries.followed:
            self._follow_up(now)
        if self._is_stale(goal, now) or (self.lost.is_lost and self._waits_for_pose(goal, now)):
            return
        if goal.new_plan is not None and not self._pass_plan(goal, goal.new_plan, now):
            return
        self._apply(NavEvent.CYCLE, now)
        mode = self._state.mode
        if mode is Mode.CONTROLLING:
            self._control(goal, now)
        elif mode is Mode.CLEARING:
            self._recover(goal, now)
        elif mode is Mode.PLANNING:
            self._check_planning_time(goal, now)
        silent = now - self._output.time >= 2.0 * self._cycles.period - EPSILON_S
        if silent and self._recoveries.running is None and self._goal is not None:
            self._output.stop_if_moving(now)

    def _change_frame(self, goal: ActiveGoal, now: float) -> None:
        """Transform the goal again, because the global costmap has another frame."""
        goal.frame = self.global_costmap.frame
        goal.pose = goal.plan = goal.new_plan = None
        self._progress = OscillationChecker(self._params.oscillation_distance)
        self._apply(NavEvent.FRAME_CHANGED, now)

    def _track(self, goal: ActiveGoal, now: float) -> bool:
        """Update pose and progress at `now` (s), and publish feedback; return False if the pose is unknown.

        An unknown pose is not an error here: the plan request and the local planner report it.
        """
        costmap, before = self.global_costmap, self._pose
        try:
            pose = call(costmap, costmap.robot_pose, now, check=checked_pose)
        except NavError:
            self._pose = None
            return False
        if before is not None:
            goal.driven_m += before.distance_to(pose)
        self._pose = goal.statistics.pose = pose
        progress = self._progress.update(pose)
        if progress is not Progress.NONE:
            goal.last_progress = now
            if progress is Progress.MOVED:
                goal.rounds = 0
                self._apply(NavEvent.MOVED, now)
        self._events.feedback(now, pose)
        return True

    def _is_stale(self, goal: ActiveGoal, now: float) -> bool:
        """Return True if the inputs must not be used at `now` (s); the robot has stopped then, or the goal has ended."""
        plan = goal.plan if self._state.mode is Mode.CONTROLLING else None
        verdict = self._sensors.check(goal, plan, self._params.controller_patience, now)
        if verdict is None:
            return False
        self._apply(verdict.event, now, verdict.error)
        return True

    def _waits_for_pose(self, goal: ActiveGoal, now: float) -> bool:
        """Return True if the robot is lost and must wait; False if it may recover in CLEARING."""
        verdict = self.lost.check(goal, self._has_recovery, now)
        if verdict is None:
            return False
        self._apply(verdict.event, now, verdict.error)
        return verdict.event is not NavEvent.LOST

    def _pass_plan(self, goal: ActiveGoal, plan: Plan, now: float) -> bool:
        """Pass a new plan to the local planner; return False if it rejects the plan, which ends the goal."""
        goal.new_plan = None
        planner = self._local_planner
        try:
            if not goal.has_plan:
                call(planner, planner.reset)
                goal.has_plan = True
            call(planner, planner.set_plan, plan.path, plan.goal)
        except NavError as exc:
            goal.statistics.add_failure(exc, now)
            self._apply(NavEvent.PLAN_REFUSED, now, exc)
            return False
        self._apply(NavEvent.PLAN_TAKEN, now)
        self._events.info(now, states.LOG_NEW_PLAN)
        return True

    def _control(self, goal: ActiveGoal, now: float) -> None:
        """End the goal if it is reached, recover without progress, send a command otherwise."""
        planner = self._local_planner
        assert goal.plan is not None
        error: NavError | None = None
        inputs: ControlInput | None = None
        try:
            inputs = self._inputs.at(goal.plan, now)
            if call(planner, planner.goal_reached, inputs, check=checked_flag):
                self._events.info(now, states.LOG_REACHED)
                self._apply(NavEvent.GOAL_REACHED, now)
                return
        except NavError as exc:
            error = exc
        if not self._makes_progress(goal, now):
            return
        try:
            if error is not None:
                raise error
            assert inputs is not None
            local_plan = self._compute_command(inputs, now)
        except NavError as exc:
            self._fail_command(goal, exc, now)
            return
        goal.statistics.commands += 1
        self._local_plan = self._output.tick.local_plan = local_plan
        self._output.send(local_plan.command, now)
        # after a stall, the list of recoveries goes on until the robot has moved
        if not self._stall.unproven:
            self._apply(NavEvent.COMMAND_FOUND, now)

    def _makes_progress(self, goal: ActiveGoal, now: float) -> bool:
        """Return False, and recover, if oscillation_timeout or the progress checker ends."""
        timeout, distance = self._params.oscillation_timeout, self._params.oscillation_distance
        checker = self._progress_checker
        error: NavError | None
        if timeout > 0.0 and now >= goal.last_progress + timeout - EPSILON_S:
            text = f"the robot moved less than {distance:g} m in {timeout:g} s"
            error = NoProgressError(text, oscillation_timeout=timeout, oscillation_distance=distance, pose=self._pose)
        elif checker is None or self._pose is None:
            return True
        else:
            error = check_progress(checker, self._pose, now)
            if error is None:
                return True
        goal.statistics.add_failure(error, now)
        self._events.failure(now, "control_failed", error)
        self._apply(NavEvent.OSCILLATING, now, error)
        return False

    def _compute_command(self, inputs: ControlInput, now: float) -> LocalPlan:
        """Return the local planner's result. Raises its error, and NoProgressError for a robot that has stalled."""
        planner, stopwatch = self._local_planner, self._stopwatch
        if self.stall_timeout_s > 0.0:
            self._stall.check(inputs.state, self._output.executed, limits_of(planner), self.stall_timeout_s, now)
        if self._limiter.is_needed:
            self._limit_speed(now)
        if stopwatch is None:
            return compute_command(planner, inputs, self._command_limits)
        began = stopwatch()
        try:
            return compute_command(planner, inputs, self._command_limits)
        finally:
            self._output.tick.control_s = stopwatch() - began

    def _limit_speed(self, now: float) -> None:
        limiter = self._limiter
        if limiter.apply(now, slowed=bool(self._recoveries.followed)):
            limit = limiter.limit
            text = "no speed limit" if limit is None else f"speed limit {limit:.2f} m/s"
            self._events.info(now, f"speed mask: {text}", max_vel_trans=limit)

    def _fail_command(self, goal: ActiveGoal, error: NavError, now: float) -> None:
        goal.statistics.add_failed_command(error, now)
        self._events.failure(now, "control_failed", error)
        exhausted = now >= goal.last_valid_control + self._params.controller_patience - EPSILON_S
        self._apply(NavEvent.CONTROL_EXHAUSTED if exhausted else NavEvent.COMMAND_FAILED, now)

    def _brake(self, now: float) -> bool:
        """Let the local planner brake after a cancel; return False when it is at rest, or does not brake.

        It ends by itself; a planner that does not is stopped after LONGEST_BRAKING_S. An error stops the robot at once.
        """
        goal, planner = self._goal, self._local_planner
        moving = self._state.mode is Mode.CONTROLLING and self._output.last != ZERO
        if goal is None or goal.plan is None or not moving or self._is_stale(goal, now):
            return False
        if goal.braking_since is None:
            goal.braking_since = now
        if min(goal.braking_since + LONGEST_BRAKING_S, goal.deadline) <= now:
            return False
        try:
            inputs = self._inputs.at(goal.plan, now)
            local_plan = brake(planner, inputs, self._command_limits)
        except NavError:
            return False
        if local_plan is None:
            return False
        self._local_plan = self._output.tick.local_plan = local_plan
        self._output.send(local_plan.command, now)
        return True

    # --- recovery -----------------------------------------------------------------------------------------------------

    @property
    def _has_recovery(self) -> bool:
        """True if a recovery behavior is left."""
        left = self._state.recovery_index < len(self._recoveries.behaviors)
        return left and self._params.recovery_behavior_enabled

    def _recover(self, goal: ActiveGoal, now: float) -> None:
        """Start the next behavior in CLEARING, or end the goal if none remains."""
        remaining = self._has_recovery
        if remaining and goal.rounds < MAX_ROUNDS * len(self._recoveries.behaviors):
            self._apply(NavEvent.RECOVERY_BEGINS, now)
            return
        if remaining:
            text = (
                f"{goal.rounds} recoveries in a row did not move the robot by {self._params.oscillation_distance:g} m: "
                "the list is not repeated again"
            )
            self._events.warn(now, text)
        self._events.warn(now, _EXHAUSTED[self._state.trigger])
        self._apply(NavEvent.RECOVERIES_EXHAUSTED, now)

    def _start_recovery(self, now: float) -> None:
        """Start the behavior at the current index and execute its first step."""
        goal = self._goal
        assert goal is not None
        behavior = self._recoveries.behaviors[self._state.recovery_index]
        goal.statistics.recoveries.append(behavior.name)
        goal.rounds += 1
        end = self._recoveries.start(behavior, now)
        if end is not None:
            self._end_recovery(end, now)
        else:
            self._step_recovery(behavior, now)

    def _run_recovery(self, behavior: Behavior, now: float) -> None:
        """Step the running behavior if due. Unlike C++, this also checks for cancels, new goals and stale sensors."""
        recoveries = self._recoveries
        check, step = recoveries.advance(now)
        if not check or self._must_end(now) or recoveries.running is not behavior:
            return
        goal = self._goal
        if goal is None or self._is_stale(goal, now):
            return
        end = recoveries.check_time_limit(behavior, now)
        if end is not None:
            self._end_recovery(end, now)
        elif step:
            self._step_recovery(behavior, now)

    def _step_recovery(self, behavior: Behavior, now: float) -> None:
        recoveries = self._recoveries
        step = recoveries.runner.step(self._inputs.state, now)
        if isinstance(step, BehaviorEnd):
            self._end_recovery(step, now)
            return
        self._output.send(step.twist, now)
        if step.text or now == recoveries.runner.started_at:
            text = step.text or f"{behavior.name} starts"
            self._publish_recovery(behavior, step.status, text, step.data, now)

    def _publish_recovery(
        self, behavior: Behavior, status: BehaviorStatus, text: str, data: dict[str, Any], now: float
    ) -> None:
        self._recoveries.publish(behavior, status, text, data, self._state, now)

    def _end_recovery(self, end: BehaviorEnd, now: float) -> None:
        recoveries, behavior = self._recoveries, end.behavior
        if end.error is not None and self._goal is not None:
            self._goal.statistics.add_failure(end.error, now)
        self._publish_recovery(behavior, end.status, end.text or f"{behavior.name} ends", end.data, now)
        recoveries.follow(behavior)
        started_at = recoveries.runner.started_at
        self._apply(NavEvent.RECOVERY_ENDED, now)
        if now > started_at:
            # as ros::Rate after a long cycle: the next cycle is due now
            self._cycles.restart(started_at)
            self._cycles.advance(started_at)
            self._cycles.resume(now)

    def _follow_up(self, now: float) -> None:
        """Follow up on ended behaviors whose effects last."""
        try:
            state = self._inputs.state(now)
        except NavError:
            return
        self._recoveries.follow_up(state, now)

    def _context_of(self, local_planner: LocalPlanner, controller_frequency: float) -> BehaviorContext:
        return BehaviorContext(
            self.global_costmap,
            self.local_costmap,
            local_planner,
            controller_frequency,
            partial(localization_status, self.robot),
            self.control_input,
            self.make_plan,
            lambda now, text: self._events.info(now, text),
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
        time_limit_s: float | None = None,
    ) -> GoalHandle:
        """Send a goal `pose` (m, rad) in `frame` (default: the global costmap's), which replaces the current goal.

        With `orientation` (x, y, z, w) the heading is that of the quaternion. `stamp` (s) defaults to the time of the last
        tick; a goal stamped before the current goal is RECALLED. `time_limit_s` counts from acceptance; `goal_time_limit_s`
        if None. An invalid goal is reported by the handle, which reaches a terminal state in every case.
        Raises InputError if `pose` is not a Pose2D, or for an invalid stamp or time limit.
        """
        name = goal_id or f"goal-{self._goal_count + 1}"
        stamp = self._now if stamp is None else stamp
        goal = make_goal(pose, frame or self.global_costmap.frame, name, stamp, orientation, time_limit_s)
        self._goal_count += 1
        return self.server.submit(goal, self._now)

    def cancel_goal(self, goal: GoalHandle | str) -> None:
        """Cancel a goal, by its handle or id. It ends within one control cycle, or when the local planner has braked."""
        self.server.cancel(self._now, goal if isinstance(goal, str) else goal.id)

    def cancel_all_goals(self) -> None:
        """Cancel every goal."""
        self.server.cancel(self._now)

    def cancel_goals_at_and_before(self, stamp: float) -> None:
        """Cancel every goal stamped up to `stamp` (s), including goals sent later."""
        self.server.cancel(self._now, None, stamp)

    # --- services -----------------------------------------------------------------------------------------------------

    def clear_costmaps(self) -> int:
        """Reset every layer of both costmaps (move_base's service clear_costmaps); return the number of cells cleared."""
        return sum(call(c, c.reset) for c in (self.local_costmap, self.global_costmap))

    def make_plan(self, goal: Pose2D, start: Pose2D | None = None, *, tolerance: float = 0.0) -> Plan:
        """Plan without driving (move_base's service make_plan), in the global costmap's frame.

        `start` defaults to the robot's pose. If the goal is unreachable, the plan ends at the first reachable pose on square
        rings around it, up to `tolerance` (m) away; `make_plan_add_unreachable_goal` then appends the goal.
        `make_plan_clear_costmap` plans as if the costmap was free within `clearing_radius` of the robot.

        Raises BusyError while a goal is active, and the planner's error for the goal itself if no plan is found.

        ROS differs: C++ clears the square in the real costmaps, and returns an empty plan if it finds none.
        """
        if self._goal is not None:
            raise BusyError(states.LOG_BUSY)
        planner = self._global_planner
        if self._planning.is_using(planner):
            raise BusyError("the global planner still works on an abandoned request; try again later")
        now = self._now if self._has_ticked else None
        return plans.plan_without_driving(
            planner, self.global_costmap, self._params, goal, start, tolerance=tolerance, now=now
        )

    # --- changes at run time ------------------------------------------------------------------------------------------

    def reconfigure(
        self,
        params: MoveBaseParams | None = None,
        *,
        global_planner: GlobalPlanner | None = None,
        local_planner: LocalPlanner | None = None,
    ) -> None:
        """Change parameters and planners at run time, as move_base's dynamic_reconfigure.

        Parameters apply from the next cycle. New planners discard every plan: an active goal continues from PLANNING, with
        the robot stopped and all timers reset. If anything raises, nothing has changed. Recovery behaviors and costmaps
        remain; `navstack.bringup.reconfigure` creates the planners from a configuration.

        Raises InputError if a planner is not one, a ParameterError if a recovery behavior does not fit.
        """
        check_plugin(global_planner, GlobalPlanner)
        check_plugin(local_planner, LocalPlanner)
        params, now = params or self._params, self._now
        context = self._context_of(local_planner or self._local_planner, params.controller_frequency)
        self._recoveries.check(context)
        limiter = self._limiter
        if local_planner is not None:
            limiter = SpeedLimiter((self.local_costmap, self.global_costmap), local_planner)
            limiter.external = self._limiter.external
        # nothing below raises
        self._set_params(params, context, now)
        if global_planner is None and local_planner is None:
            return
        if global_planner is not None:
            self._global_planner = global_planner
        if local_planner is not None:
            self._local_planner = self._inputs.planner = local_planner
            self._limiter = limiter
            self._command_limits = CommandLimits(local_planner)
            self._recoveries.followed.clear()  # the effects were on the previous planner
        self._planning.abandon()
        self._local_plan = None
        if self._goal is not None:
            self._goal.plan = self._goal.new_plan = None
        names = f"{type(self._global_planner).__name__}, {type(self._local_planner).__name__}"
        self._events.info(now, f"planners changed: {names}")
        self._apply(NavEvent.PLANNERS_CHANGED, now)

    def _set_params(self, params: MoveBaseParams, context: BehaviorContext, now: float) -> None:
        before, self._params = self._params, params
        self._recoveries.set_context(context, now)
        self.motions.params, self.motions.context = params, context
        self._inputs.settle_s = 0.5 * params.controller_patience
        self._cycles.set_frequency(params.controller_frequency, now)
        may_plan = self._state.mode in (Mode.PLANNING, Mode.CONTROLLING)
        self._plans.set_params(params, now, may_plan=may_plan)
        if params.oscillation_distance != before.oscillation_distance:
            self._progress = OscillationChecker(params.oscillation_distance)
        if params.sections != before.sections:
            self._progress_checker = params.make_progress_checker()
        if params.shutdown_costmaps != before.shutdown_costmaps:
            self._costmaps.enable(self._goal is not None or not params.shutdown_costmaps, now)

    def costmaps_changed(self) -> None:
        """Read the costmaps' update frequencies and tolerances again, after their parameters have changed."""
        self._costmaps.read_frequencies(self._now)
        self._inputs.read_parameters()
        self._events.info(self._now, "costmaps changed")

    def limit_speed(self, limit: float | None) -> None:
        """Drive at most at `limit` (m/s) from the next cycle on, as Nav2's topic speed_limit says; None or 0 for no limit.

        A lower limit of a costmap counts. Raises InputError for a limit that is negative or not finite.
        """
        if limit is not None and not (math.isfinite(limit) and limit >= 0.0):
            raise InputError(f"a speed limit is {limit} m/s; give a finite one of 0 or more", limit=limit)
        self._limiter.external = limit or None

    # --- state --------------------------------------------------------------------------------------------------------

    @property
    def speed_limit(self) -> float | None:
        """The limit of `limit_speed` (m/s)."""
        return self._limiter.external

    @property
    def now(self) -> float:
        """Time of the last tick (s)."""
        return self._now

    @property
    def last_tick(self) -> TickResult:
        """The result of the last tick."""
        return self._output.tick

    @property
    def params(self) -> MoveBaseParams:
        """The parameters."""
        return self._params

    @property
    def global_planner(self) -> GlobalPlanner:
        """The global planner."""
        return self._global_planner

    @property
    def local_planner(self) -> LocalPlanner:
        """The local planner."""
        return self._local_planner

    @property
    def recoveries(self) -> tuple[Behavior, ...]:
        """The recovery behaviors, in order."""
        return self._recoveries.behaviors

    @property
    def state(self) -> Mode:
        """IDLE, PLANNING, CONTROLLING or CLEARING."""
        return self._state.mode

    @property
    def activity(self) -> str:
        """The name of `state`, or MOTION while a motion runs: what the robot is doing, for records."""
        return ACTIVITY if self.motions.running is not None else self._state.mode.name

    @property
    def trigger(self) -> Trigger:
        """Reason of the last recovery."""
        return self._state.trigger

    @property
    def recovery_index(self) -> int:
        """Index of the running or next recovery behavior."""
        return self._state.recovery_index

    @property
    def recovery(self) -> str | None:
        """Name of the running recovery behavior."""
        running = self._recoveries.running
        return running.name if running is not None else None

    @property
    def recovery_context(self) -> BehaviorContext:
        """What a recovery behavior may act on, to run one while no goal is active."""
        return self._recoveries.context

    @property
    def goal_handle(self) -> GoalHandle | None:
        """The active goal."""
        goal = self._goal
        return goal.handle if goal is not None else None

    @property
    def goal_pose(self) -> Pose2D | None:
        """The active goal in the global costmap's frame."""
        goal = self._goal
        return goal.pose if goal is not None else None

    @property
    def plan(self) -> Plan | None:
        """The global planner's last plan for the active goal."""
        return self._goal.plan if self._goal is not None else None

    @property
    def local_plan(self) -> LocalPlan | None:
        """The local planner's last result for the active goal."""
        return self._local_plan

    @property
    def command(self) -> Twist2D:
        """The last command."""
        return self._output.last

    @property
    def chain(self) -> CommandChain | None:
        """What stands between the commands and the robot; None without it."""
        return self._output.chain

    @property
    def robot_pose(self) -> Pose2D | None:
        """The robot in the global costmap's frame in the last control cycle; None if unknown."""
        return self._pose

    @property
    def feedback(self) -> Feedback:
        """Feedback on the active goal, computed on request."""
        if self._goal is None:
            return Feedback(self._pose, self._state.mode, 0.0, 0.0, None, 0)
        return self._goal.feedback(self._pose, self._state.mode, self._now)

    def control_input(self, plan: Plan, now: float) -> ControlInput:
        """Return the local planner's input for `plan` at `now` (s), to follow a path without a goal. Raises NavError."""
        return self._inputs.at(plan, now)

    def local_state(self, now: float) -> RobotState:
        """Return the robot's pose in the local costmap's frame at `now` (s), and its velocity. Raises NavError."""
        return self._inputs.state(now)
