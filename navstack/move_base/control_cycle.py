"""One control cycle: new plan, command of the local planner, and its failures.

Source: move_base/src/move_base.cpp (executeCycle).
"""

from __future__ import annotations

from typing import Final

from navstack.core.errors import NavError
from navstack.interfaces import ControlInput, Plan
from navstack.move_base import plugin_calls, status_messages
from navstack.move_base.active_goal import ActiveGoal
from navstack.move_base.command_output import ZERO, CommandOutput
from navstack.move_base.costmap_updater import CostmapUpdater
from navstack.move_base.errors import NoProgressError
from navstack.move_base.goal_lifecycle import GoalLifecycle
from navstack.move_base.lost_check import LostCheck
from navstack.move_base.navigation import Navigation
from navstack.move_base.plan_requests import PlanRequests
from navstack.move_base.pose_tracker import PoseTracker
from navstack.move_base.progress import OscillationChecker
from navstack.move_base.recovery_sequence import RecoverySequence
from navstack.move_base.schedule import EPSILON_S, Schedule
from navstack.move_base.speed_limiter import SpeedLimiter
from navstack.move_base.stale_sensors import StaleSensorCheck
from navstack.move_base.states import Mode, NavEvent

LONGEST_BRAKING_S: Final = 5.0
"""A local planner that still brakes then is stopped (s)."""


class ControlCycle:
    """Runs a control cycle while a goal is active and no recovery behavior is running."""

    def __init__(
        self,
        navigation: Navigation,
        schedule: Schedule,
        command: CommandOutput,
        costmaps: CostmapUpdater,
        goals: GoalLifecycle,
        sensors: StaleSensorCheck,
        plan_requests: PlanRequests,
        recovery: RecoverySequence,
    ) -> None:
        self.schedule = schedule
        self.speed_limiter = SpeedLimiter(
            (navigation.local_costmap, navigation.global_costmap), navigation.local_planner
        )
        self._navigation = navigation
        self._command = command
        self._costmaps = costmaps
        self._goals = goals
        self._sensors = sensors
        self._plan_requests = plan_requests
        self._recovery = recovery
        self._tracker = PoseTracker(navigation)
        self.lost = LostCheck(navigation, costmaps.restart)
        self.progress_checker = navigation.params.make_progress_checker()
        """The progress checker of the parameters, beside oscillation_timeout; None without one."""
        self.stall_timeout_s = 0.0
        """Longest time (s) that the robot may stand still although it is commanded to move; 0 for no limit."""

    def reset_control_patience(self, now: float) -> None:
        """Restart controller_patience at `now` (s)."""
        goal = self._navigation.goal
        if goal is not None:
            goal.last_valid_control = now

    def reset_oscillation(self, now: float) -> None:
        """Restart oscillation_timeout at `now` (s)."""
        goal = self._navigation.goal
        if goal is not None:
            goal.last_progress = now
            goal.stall.reset()
        if self.progress_checker is not None:
            self.progress_checker.reset()

    def run(self, now: float) -> None:
        """Run the cycle of `now` (s)."""
        self.schedule.advance(now)
        if self._goals.is_canceled and self._brake(now):
            return
        if self._goals.must_end(now):
            return
        navigation = self._navigation
        goal = navigation.goal
        assert goal is not None
        if navigation.global_costmap.frame != goal.frame:
            self._change_frame(goal, now)
        if self._tracker.update(goal, now) and self._recovery.followed:
            self._recovery.follow_up(now)
        if self._sensors.is_stale(goal, now) or self.lost.blocks(goal, now):
            return
        if navigation.new_plan is not None and not self._pass_plan(goal, navigation.new_plan, now):
            return
        navigation.apply(NavEvent.CYCLE, now)
        mode = navigation.state.mode
        if mode is Mode.CONTROLLING:
            self._control(goal, now)
        elif mode is Mode.CLEARING:
            self._recovery.start_or_abort(now)
        elif mode is Mode.PLANNING:
            self._plan_requests.check_timeout(now)
        if now - self._command.time >= 2.0 * self.schedule.period - EPSILON_S:
            self._stop_without_command(now)

    def _brake(self, now: float) -> bool:
        """Let the local planner brake after a cancel; return False when it is at rest, or does not brake.

        It ends by itself; a planner that does not is stopped after LONGEST_BRAKING_S. An error stops the robot at once.
        """
        navigation = self._navigation
        goal, plan = navigation.goal, navigation.plan
        moving = navigation.state.mode is Mode.CONTROLLING and self._command.last != ZERO
        if goal is None or plan is None or not moving or self._sensors.is_stale(goal, now):
            return False
        if goal.braking_since is None:
            goal.braking_since = now
        if min(goal.braking_since + LONGEST_BRAKING_S, goal.deadline) <= now:
            return False
        try:
            inputs = self._costmaps.control_input(plan, now)
            local_plan = plugin_calls.brake(navigation.local_planner, inputs)
        except NavError:
            return False
        if local_plan is None:
            return False
        navigation.local_plan = navigation.last_tick.local_plan = local_plan
        self._command.send(local_plan.command, now)
        return True

    def _change_frame(self, goal: ActiveGoal, now: float) -> None:
        """Transform the goal again, because the global costmap has another frame."""
        navigation = self._navigation
        goal.frame = navigation.global_costmap.frame
        goal.pose = None
        goal.progress = OscillationChecker(navigation.params.oscillation_distance)
        navigation.plan = navigation.new_plan = None
        navigation.apply(NavEvent.FRAME_CHANGED, now)

    def _pass_plan(self, goal: ActiveGoal, plan: Plan, now: float) -> bool:
        """Pass a new plan to the local planner; return False if it rejects the plan, which ends the goal."""
        navigation = self._navigation
        navigation.new_plan = None
        try:
            if not goal.has_plan:
                plugin_calls.call(navigation.local_planner, navigation.local_planner.reset)
                goal.has_plan = True
            plugin_calls.set_plan(navigation.local_planner, plan)
        except NavError as exc:
            goal.statistics.add_failure(exc, now)
            navigation.apply(NavEvent.PLAN_REFUSED, now, exc)
            return False
        navigation.apply(NavEvent.PLAN_TAKEN, now)
        navigation.events.info(now, status_messages.LOG_NEW_PLAN)
        return True

    def _control(self, goal: ActiveGoal, now: float) -> None:
        """End the goal if it is reached, recover without progress, send a command otherwise."""
        navigation = self._navigation
        plan = navigation.plan
        assert plan is not None
        error: NavError | None = None
        inputs: ControlInput | None = None
        try:
            inputs = self._costmaps.control_input(plan, now)
            if plugin_calls.goal_reached(navigation.local_planner, inputs):
                navigation.events.info(now, status_messages.LOG_REACHED)
                navigation.apply(NavEvent.GOAL_REACHED, now)
                return
        except NavError as exc:
            error = exc
        timeout = navigation.params.oscillation_timeout
        if timeout > 0.0 and now >= goal.last_progress + timeout - EPSILON_S:
            distance = navigation.params.oscillation_distance
            text = f"moved less than {distance:g} m in {timeout:g} s"
            self._report_no_progress(goal, text, now, oscillation_timeout=timeout, oscillation_distance=distance)
            return
        checker = self.progress_checker
        if checker is not None and navigation.pose is not None and not checker.makes_progress(navigation.pose, now):
            self._report_no_progress(goal, checker.failure, now)
            return
        try:
            if error is not None:
                raise error
            assert inputs is not None
            if self.stall_timeout_s > 0.0:
                limits = plugin_calls.limits_of(navigation.local_planner)
                goal.stall.check(inputs.state, self._command.executed, limits, self.stall_timeout_s, now)
            self._send_command(goal, inputs, now)
        except NavError as exc:
            self._report_failure(goal, exc, now)

    def _send_command(self, goal: ActiveGoal, inputs: ControlInput, now: float) -> None:
        navigation = self._navigation
        if self.speed_limiter.is_needed:
            self._apply_speed_limit(now)
        local_plan = plugin_calls.compute_command(navigation.local_planner, inputs)
        navigation.local_plan = navigation.last_tick.local_plan = local_plan
        goal.statistics.commands += 1
        self._command.send(local_plan.command, now)
        # after a stall, the list of recoveries goes on until the robot has moved
        if not goal.stall.unproven:
            navigation.apply(NavEvent.COMMAND_FOUND, now)

    def _apply_speed_limit(self, now: float) -> None:
        limiter = self.speed_limiter
        if limiter.apply(now, slowed=bool(self._recovery.followed)):
            limit = limiter.limit
            text = "no speed limit" if limit is None else f"speed limit {limit:.2f} m/s"
            self._navigation.events.info(now, f"speed mask: {text}", max_vel_trans=limit)

    def _report_no_progress(self, goal: ActiveGoal, text: str, now: float, **data: float) -> None:
        navigation = self._navigation
        error = NoProgressError(f"the robot {text}", **data, pose=navigation.pose)
        goal.statistics.add_failure(error, now)
        navigation.events.failure(now, "control_failed", error)
        navigation.apply(NavEvent.OSCILLATING, now, error)

    def _report_failure(self, goal: ActiveGoal, error: NavError, now: float) -> None:
        navigation = self._navigation
        goal.statistics.add_failed_command(error, now)
        navigation.events.failure(now, "control_failed", error)
        patience_ends = goal.last_valid_control + navigation.params.controller_patience
        exhausted = now >= patience_ends - EPSILON_S
        navigation.apply(NavEvent.CONTROL_EXHAUSTED if exhausted else NavEvent.COMMAND_FAILED, now)

    def _stop_without_command(self, now: float) -> None:
        """Stop the robot in a cycle without a command, unless a recovery behavior controls it."""
        if self._recovery.runner.running is None and not self._navigation.is_idle:
            self._command.stop_if_moving(now)
