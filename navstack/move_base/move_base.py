"""The goal manager: accepts goals, plans, drives and recovers, and ends every goal with a reason.

Source: move_base/src/move_base.cpp. `MoveBase.tick` is one update cycle; `parts.py` lists its parts. A plan is passed to the
local planner in the control cycle after its request, as in C++, where it arrives from another thread a few milliseconds
later. Nothing here sleeps, starts a thread or reads a clock.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from navstack.core import Listener, Pose2D, RobotState, Twist2D
from navstack.core.errors import InputError
from navstack.interfaces import (
    ControlInput,
    CostmapServer,
    GlobalPlanner,
    LocalPlan,
    LocalPlanner,
    Plan,
    RecoveryBehavior,
    RecoveryContext,
    Robot,
)
from navstack.move_base import make_plan, plugin_calls, status_messages
from navstack.move_base.errors import BusyError
from navstack.move_base.events import EventPublisher
from navstack.move_base.feedback import Feedback, feedback_of
from navstack.move_base.goal import GoalHandle, Quaternion, make_goal
from navstack.move_base.motion_runner import ACTIVITY
from navstack.move_base.navigation import Navigation
from navstack.move_base.parts import connect_parts
from navstack.move_base.planning import InlinePlanning, Planning
from navstack.move_base.reconfiguration import reconfigure
from navstack.move_base.schedule import EPSILON_S, SCAN_MARGIN_S
from navstack.move_base.states import Mode, NavEvent, Trigger
from navstack.move_base.tick_result import TickResult
from navstack.parameters.models.move_base import MoveBaseParams
from navstack.safety import CommandChain


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
        recoveries: Sequence[RecoveryBehavior] = (),
        listeners: Sequence[Listener] = (),
        planning: Planning | None = None,
        global_update_frequency: float | None = None,
        local_update_frequency: float | None = None,
        recovery_time_limit_s: float = 120.0,
        goal_time_limit_s: float = math.inf,
        stall_timeout_s: float = 0.0,
    ) -> None:
        """Create a goal manager; `planning` defaults to `InlinePlanning` without delay.

        The update frequencies (Hz) default to the costmaps' parameters. A recovery behavior that runs longer than
        `recovery_time_limit_s` fails; a goal that runs longer than `goal_time_limit_s` after its acceptance is aborted.
        ROS differs: C++ has no such limit; without one, a goal can last forever if oscillation_timeout is 0. A robot that does
        not move for `stall_timeout_s` although it is commanded to has no valid control (0: no check).

        Raises a ParameterError if the parameters of a recovery behavior do not fit the costmaps.
        """
        events = EventPublisher(listeners)
        plugins = (robot, global_costmap, local_costmap, global_planner, local_planner, tuple(recoveries))
        navigation = self._navigation = Navigation(params, *plugins, events)
        frequencies = (global_update_frequency, local_update_frequency)
        parts = connect_parts(navigation, planning or InlinePlanning(), frequencies, recovery_time_limit_s)
        self._costmaps = parts.costmaps
        self.lost = parts.control.lost
        """What happens while the robot does not know where it is."""
        self._command = parts.command
        self._plan_requests = parts.plan_requests
        self._recovery = parts.recovery
        self._control = parts.control
        self.motions = parts.motions
        """Motions and commands from outside, while no goal is active."""
        self._parts = parts
        self._now = 0.0
        self._has_ticked = False
        self._is_shut_down = False
        self._goal_count = 0
        self.server = parts.server
        self.robot = robot
        self.global_costmap = global_costmap
        self.local_costmap = local_costmap
        self.listeners = events.listeners
        self.goal_time_limit_s = goal_time_limit_s
        self.stall_timeout_s = stall_timeout_s

    # --- update cycle -------------------------------------------------------------------------------------------------

    def next_due(self, now: float) -> float:
        """Return the next time (s) at which `tick` has work, at least `now`; inf for never."""
        if not self._has_ticked:
            return now
        if self._navigation.is_idle:
            idle = min(self._costmaps.due, self._command.due, self.motions.due)
            return now if self.server.is_new_goal_available else max(now, idle)
        control = self._control.schedule if self._recovery.runner.running is None else self._recovery.runner
        return max(now, min(self._costmaps.due, control.due, self._plan_requests.due, self._command.due))

    def tick(self, now: float) -> None:
        """Update sensors, update the costmaps that are due, control or recover, and replan if due, at `now` (s).

        Call it at `next_due`; additional calls are allowed. Raises InputError if the time runs backwards. Failures of
        plugins, costmaps and the robot end in the result of the goal.
        """
        tick = self._start_tick(now)
        now = tick.time
        self._command.begin(now)
        self._costmaps.observe(now, tick)
        self.lost.observe(now)
        self._accept_waiting_goal(now)
        self._costmaps.update(now, tick)
        if self._navigation.goal is not None:
            self._plan_requests.receive(now)
            self._recover_or_control(now)
            self._plan_requests.request_if_due(now)
        else:
            self.motions.run(now)
        self._command.flush(now)
        self._command.abort_after_error(now)

    def follow_scans(self, now: float) -> None:
        """Let the cycles follow right after scans, one of which arrived at `now` (s); the control period hardly changes."""
        control = self._control.schedule
        control.approach(now + 2.0 * SCAN_MARGIN_S)
        self._costmaps.approach(now + SCAN_MARGIN_S, control.due - SCAN_MARGIN_S)

    def shutdown(self) -> None:
        """End every goal ("node has been killed") and stop the robot. Later goals end at once."""
        self._is_shut_down = True
        self.motions.cancel()
        self._navigation.apply(NavEvent.SHUTDOWN, self._now)
        self._accept_waiting_goal(self._now)
        self._command.halt(self._now)

    def _start_tick(self, now: float) -> TickResult:
        if not now >= self._now - EPSILON_S or not math.isfinite(now):
            message = f"time must not run backwards: tick({now}) after tick({self._now})"
            raise InputError(message, now=now, last=self._now)
        now = self._now = max(now, self._now)
        if not self._has_ticked:
            self._has_ticked = True
            self._costmaps.restart(now)
        tick = self._navigation.last_tick = TickResult(now)
        return tick

    def _accept_waiting_goal(self, now: float) -> None:
        navigation = self._navigation
        if navigation.goal is not None or not self.server.is_new_goal_available:
            return
        self.motions.cancel()
        goal = self._parts.goals.accept(now)
        if self._is_shut_down:
            navigation.apply(NavEvent.GOAL_ACCEPTED, now)
            navigation.apply(NavEvent.SHUTDOWN, now)
        elif goal.error is not None:
            navigation.apply(NavEvent.GOAL_INVALID, now)
        else:
            self._control.schedule.restart(now)
            self._command.error = None
            self._costmaps.retry_failed(now)
            navigation.apply(NavEvent.GOAL_ACCEPTED, now)

    def _recover_or_control(self, now: float) -> None:
        runner, control = self._recovery.runner, self._control
        if runner.running is not None:
            self._recovery.run(runner.running, now)
        if runner.running is None and control.schedule.is_due(now) and self._navigation.goal is not None:
            control.run(now)

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
        """Send a goal `pose` (m, rad) in `frame` (default: the global costmap's), which replaces the present goal.

        With `orientation` (x, y, z, w) the heading is that of the quaternion. `stamp` (s) defaults to the time of the last
        tick; a goal stamped before the present goal is RECALLED. `time_limit_s` counts from acceptance; `goal_time_limit_s`
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
        return sum(plugin_calls.call(c, c.reset) for c in (self.local_costmap, self.global_costmap))

    def make_plan(self, goal: Pose2D, start: Pose2D | None = None, *, tolerance: float = 0.0) -> Plan:
        """Plan without driving (move_base's service make_plan), in the global costmap's frame.

        `start` defaults to the robot's pose. If the goal is unreachable, the plan ends at the first reachable pose on square
        rings around it, up to `tolerance` (m) away; `make_plan_add_unreachable_goal` then appends the goal.
        `make_plan_clear_costmap` plans as if the costmap was free within `clearing_radius` of the robot.

        Raises BusyError while a goal is active, and the planner's error for the goal itself if no plan is found.

        ROS differs: C++ clears the square in the real costmaps, and returns an empty plan if it finds none.
        """
        if not self._navigation.is_idle:
            raise BusyError(status_messages.LOG_BUSY)
        planner = self.global_planner
        if self._plan_requests.is_using(planner):
            raise BusyError("the global planner still works on an abandoned request; try again later")
        now = self._now if self._has_ticked else None
        return make_plan.make_plan(planner, self.global_costmap, self.params, goal, start, tolerance=tolerance, now=now)

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
        reconfigure(self._parts, params, global_planner, local_planner, self._now)

    def costmaps_changed(self) -> None:
        """Read the costmaps' update frequencies again, after their parameters have changed."""
        self._costmaps.read_frequencies(self._now)
        self._navigation.events.info(self._now, "costmaps changed")

    # --- state --------------------------------------------------------------------------------------------------------

    @property
    def now(self) -> float:
        """Time of the last tick (s)."""
        return self._now

    @property
    def last_tick(self) -> TickResult:
        """The result of the last tick."""
        return self._navigation.last_tick

    @property
    def params(self) -> MoveBaseParams:
        """The parameters."""
        return self._navigation.params

    @property
    def global_planner(self) -> GlobalPlanner:
        """The global planner."""
        return self._navigation.global_planner

    @property
    def local_planner(self) -> LocalPlanner:
        """The local planner."""
        return self._navigation.local_planner

    @property
    def recoveries(self) -> tuple[RecoveryBehavior, ...]:
        """The recovery behaviors, in order."""
        return self._navigation.recoveries

    @property
    def state(self) -> Mode:
        """IDLE, PLANNING, CONTROLLING or CLEARING."""
        return self._navigation.state.mode

    @property
    def activity(self) -> str:
        """The name of `state`, or MOTION while a motion runs: what the robot is doing, for records."""
        return ACTIVITY if self.motions.running is not None else self._navigation.state.mode.name

    @property
    def trigger(self) -> Trigger:
        """Reason of the last recovery."""
        return self._navigation.state.trigger

    @property
    def recovery_index(self) -> int:
        """Index of the running or next recovery behavior."""
        return self._navigation.state.recovery_index

    @property
    def recovery(self) -> str | None:
        """Name of the running recovery behavior."""
        running = self._recovery.runner.running
        return running.name if running is not None else None

    @property
    def recovery_context(self) -> RecoveryContext:
        """What a recovery behavior may act on, to run one while no goal is active."""
        return self._recovery.context

    @property
    def goal_handle(self) -> GoalHandle | None:
        """The active goal."""
        goal = self._navigation.goal
        return goal.handle if goal is not None else None

    @property
    def goal_pose(self) -> Pose2D | None:
        """The active goal in the global costmap's frame."""
        goal = self._navigation.goal
        return goal.pose if goal is not None else None

    @property
    def plan(self) -> Plan | None:
        """The global planner's last plan for the active goal."""
        return self._navigation.plan

    @property
    def local_plan(self) -> LocalPlan | None:
        """The local planner's last result for the active goal."""
        return self._navigation.local_plan

    @property
    def command(self) -> Twist2D:
        """The last command."""
        return self._command.last

    @property
    def chain(self) -> CommandChain | None:
        """What stands between the commands and the robot; None without it."""
        return self.robot if isinstance(self.robot, CommandChain) else None

    @property
    def robot_pose(self) -> Pose2D | None:
        """The robot in the global costmap's frame in the last control cycle; None if unknown."""
        return self._navigation.pose

    @property
    def feedback(self) -> Feedback:
        """Feedback on the active goal, computed on request."""
        return feedback_of(self._navigation, self._now)

    @property
    def goal_time_limit_s(self) -> float:
        """Time limit of goals without one of their own (s from acceptance); inf for none."""
        return self._parts.goals.time_limit_s

    @goal_time_limit_s.setter
    def goal_time_limit_s(self, limit: float) -> None:
        self._parts.goals.time_limit_s = limit

    @property
    def stall_timeout_s(self) -> float:
        """Longest time (s) that the robot may stand still although it is commanded to move; 0 for no limit."""
        return self._control.stall_timeout_s

    @stall_timeout_s.setter
    def stall_timeout_s(self, timeout: float) -> None:
        self._control.stall_timeout_s = timeout

    def control_input(self, plan: Plan, now: float) -> ControlInput:
        """Return the local planner's input for `plan` at `now` (s), to follow a path without a goal. Raises NavError."""
        return self._costmaps.control_input(plan, now)

    def local_state(self, now: float) -> RobotState:
        """Return the robot's pose in the local costmap's frame at `now` (s), and its velocity. Raises NavError."""
        return self._costmaps.local_state(now)
