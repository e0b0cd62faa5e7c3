"""Base of DWA and trajectory rollout: plan, goal checker, critics, and braking and turning at the goal."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.core import (
    ControlError,
    Costmap,
    Footprint,
    InvalidPathError,
    NoValidControlError,
    Path,
    Pose2D,
    RobotState,
    Twist2D,
    angle_between,
)
from navstack.local_planner.critics.obstacle import ObstacleCritic
from navstack.local_planner.path_handlers import NearbyPlan
from navstack.local_planner.scoring import ScoreTable, control_diagnostics, rejection_report, score
from navstack.plugins import (
    Approach,
    ControlDiagnostics,
    ControlInput,
    Critic,
    GoalChecker,
    LocalPlan,
    LocalPlanner,
    Rollouts,
    ScoringContext,
    TrajectoryGenerator,
    VelocityLimits,
)

DEFAULT_PERIOD_S = 0.05
"""Control period if controller_frequency is 0."""
SAME_GOAL = 1e-6
"""Goals that differ by less (m, rad) are the same goal."""


class SamplingPlanner(LocalPlanner):
    """Follows a plan by `search`, a selection among velocity samples; at the goal's position brakes, then turns in place.

    State between cycles: the plan, the goal checker, the phase at the goal.
    """

    def __init__(
        self,
        params: Any,
        critics: list[Critic],
        collision_check: ObstacleCritic,
        goal_checker: GoalChecker,
        generator: TrajectoryGenerator,
    ) -> None:
        """`collision_check` checks commands at the goal; it may be one of `critics`."""
        super().__init__(params)
        self.critics = critics
        self.goal_checker = goal_checker
        self.generator = generator
        self._names = tuple(critic.name for critic in critics)
        self._collision_check = collision_check
        self._period = control_period(params.controller_frequency)
        self._path = NearbyPlan()
        self._goal: Pose2D | None = None
        self._rotating = False
        self._limits: VelocityLimits
        self._last: tuple[ScoringContext, Rollouts, ScoreTable, LocalPlan] | None = None
        self.set_limits()

    # --- limits -----------------------------------------------------------------------------------------------------

    @property
    def limits(self) -> VelocityLimits:
        """The limits in force."""
        return self._limits

    def set_limits(self, *, max_vel_trans: float | None = None, max_vel_theta: float | None = None) -> None:
        """Lower the speed limits (m/s, rad/s) until the next call; None restores the parameter's value."""
        for name, value in (("max_vel_trans", max_vel_trans), ("max_vel_theta", max_vel_theta)):
            if value is not None and not (math.isfinite(value) and value >= 0.0):
                raise ControlError(f"{name} must be a finite speed of at least 0, not {value}", limit=name, value=value)
        self._limits = self.lowered_limits(max_vel_trans, max_vel_theta)

    @abstractmethod
    def lowered_limits(self, max_vel_trans: float | None, max_vel_theta: float | None) -> VelocityLimits:
        """The limits of the parameters, lowered to these speeds (None: not lowered)."""

    def turning_limits(self) -> tuple[VelocityLimits, float]:
        """Limits of the turn at the goal, and its lowest speed (rad/s)."""
        return self._limits, self._limits.min_vel_theta

    # --- plan and goal ----------------------------------------------------------------------------------------------

    def set_plan(self, plan: Path, goal: Pose2D) -> None:
        """Follow `plan` to `goal`; with the same goal as before it is a replan, and a latched position remains latched."""
        if not goal.is_finite():
            raise ControlError(f"the goal {tuple(goal)} is not finite", goal=list(goal))
        self._path.set_plan(plan)
        before, self._goal = self._goal, Pose2D(*goal)
        # ROS differs: there every replan releases the latch (parity 17)
        if before is None or any(abs(a - b) > SAME_GOAL for a, b in zip(before, goal)):
            self.goal_changed()
        self.reset_critics()

    def reset(self) -> None:
        """Reset the previous goal, and with it a latched position."""
        self._goal = None

    def goal_changed(self) -> None:
        """Called by `set_plan` for a new goal."""
        self.goal_checker.reset()
        self._rotating = False

    def reset_critics(self) -> None:
        """Clear the state that critics keep between cycles."""
        for critic in self.critics:
            critic.reset()

    def goal_reached(self, inputs: ControlInput) -> bool:
        """Position (or latched), heading and stopped."""
        if self._goal is None:
            return False
        goal = inputs.plan_to_costmap.apply(self._goal)
        return self.goal_checker.reached(Approach(inputs.state.pose, goal, inputs.state.velocity))

    # --- the command ------------------------------------------------------------------------------------------------

    def compute_command(self, inputs: ControlInput) -> LocalPlan:
        """Follow the plan, or brake and turn at the goal's position.

        Raises InvalidPathError if no part of the plan is near, NoValidControlError if every sample is rejected.
        """
        state = inputs.state
        self._last = None
        if not (state.pose.is_finite() and state.velocity.is_finite()):
            raise ControlError(
                f"the robot's pose {tuple(state.pose)} or velocity {tuple(state.velocity)} is not finite",
                pose=list(state.pose),
                velocity=list(state.velocity),
            )
        if self._goal is None:
            raise InvalidPathError("the local planner has no plan to follow: call set_plan first", poses=0)
        plan = self._path.nearby_plan(
            state.pose, inputs.plan_to_costmap, inputs.costmap.geometry, prune=self.params.prune_plan
        )
        goal = inputs.plan_to_costmap.apply(self._goal)
        if self.goal_checker.at_position(Approach(state.pose, goal)):
            return self._stop_and_rotate(inputs, plan, goal)
        return self.search(state, inputs.costmap, inputs.footprint, plan, goal)

    @abstractmethod
    def search(
        self,
        state: RobotState,
        costmap: Costmap,
        footprint: Footprint,
        plan: NDArray[np.float64],
        goal: Pose2D,
    ) -> LocalPlan:
        """Select a sample for following `plan` (n, 3), all in the costmap's frame; raises NoValidControlError."""

    def context(
        self, state: RobotState, costmap: Costmap, footprint: Footprint, plan: NDArray[np.float64], goal: Pose2D
    ) -> ScoringContext:
        """Input of the critics; the costmap is copied if kernels cannot use its array."""
        flags = costmap.data.flags
        if not (flags.c_contiguous and flags.writeable):  # a view, or read-only
            costmap = costmap.copy()
        return ScoringContext(state, costmap, footprint, plan, goal, self._limits)

    def result(
        self,
        command: Twist2D,
        samples: NDArray[np.float64],
        table: ScoreTable,
        rollouts: Rollouts,
        context: ScoringContext,
        mode: str = "follow",
    ) -> LocalPlan:
        """The command with its table; raises NoValidControlError with the table if no sample is legal."""
        plan = self._local_plan(command, samples, table, rollouts, context, mode)
        if table.best < 0:
            text, data = rejection_report(table, self.critics, samples)
            raise NoValidControlError(text, **data, plan=plan)
        for critic in self.critics:
            critic.debrief(command, context.state.pose)
        return plan

    def _local_plan(
        self,
        command: Twist2D,
        samples: NDArray[np.float64],
        table: ScoreTable,
        rollouts: Rollouts,
        context: ScoringContext,
        mode: str,
    ) -> LocalPlan:
        best = table.best
        plan = LocalPlan(
            command,
            mode,
            samples,
            self._names,
            table.costs,
            table.scales,
            table.totals,
            table.rejected_by,
            best,
            rollouts.poses[best, : rollouts.counts[best]].copy() if best >= 0 else None,
            Path(context.plan, context.costmap.frame),
            tuple(context.notes),
        )
        self._last = context, rollouts, table, plan
        return plan

    # --- diagnostics ------------------------------------------------------------------------------------------------

    def diagnostics(self) -> ControlDiagnostics | None:
        """Diagnostics of the last cycle, legal or not; None before the first, without a search, and on arrival."""
        if self._last is None:
            return None
        context, rollouts, table, plan = self._last
        at_goal = plan.mode not in ("follow", "escape")
        critics: list[Critic] = [self._collision_check] if at_goal else self.critics
        return control_diagnostics(plan, context, rollouts, table, self.critics, self.rule, rejecting=critics)

    @property
    def rule(self) -> str:
        """How the planner selects a sample, if not simply by the lowest total."""
        return ""

    # --- at the goal's position -------------------------------------------------------------------------------------

    def _stop_and_rotate(self, inputs: ControlInput, plan: NDArray[np.float64], goal: Pose2D) -> LocalPlan:
        state = inputs.state
        if self.goal_checker.at_heading(Approach(state.pose, goal)):
            self._rotating = False
            return LocalPlan(
                Twist2D(),
                "arrived",
                np.empty((0, 3)),
                self._names,
                np.empty((0, len(self._names))),
                np.zeros(len(self._names)),
                np.empty(0),
                np.empty(0, np.int8),
                local_plan=Path(plan, inputs.costmap.frame),
            )
        if not self._rotating and not self.goal_checker.stopped(state.velocity):
            mode, action = "brake", "braking"
            command = braking_twist(state.velocity, self._limits, self._period)
        else:
            self._rotating = True
            mode, action = "rotate_to_goal", "turning in place"
            limits, slowest = self.turning_limits()
            error = angle_between(state.pose.yaw, goal.yaw)
            command = turning_twist(error, state.velocity.wz, limits, self._period, slowest)
        return self._checked(command, mode, action, inputs, plan, goal)

    def _checked(
        self, command: Twist2D, mode: str, action: str, inputs: ControlInput, plan: NDArray[np.float64], goal: Pose2D
    ) -> LocalPlan:
        """`command` if its rollout is free of collisions; raises NoValidControlError otherwise."""
        self.reset_critics()
        context = self.context(inputs.state, inputs.costmap, inputs.footprint, plan, goal)
        samples = np.array([command])
        rollouts = self.generator.simulate(samples, inputs.state, without_speed_limits(self._limits))
        if rollouts.counts[0] == 0:  # a command of zero: check the current pose
            rollouts.counts[0] = 1
            rollouts.poses[0, 0] = inputs.state.pose
        checked = score([self._collision_check], context, rollouts)
        legal = checked.best >= 0
        table = self._all_columns(checked)
        local = self._local_plan(command if legal else Twist2D(), samples, table, rollouts, context, mode)
        self._last = context, rollouts, checked, local
        if not legal:
            text, data = rejection_report(checked, [self._collision_check], samples)
            raise NoValidControlError(
                f"{action} at the goal at ({command.vx:.3f}, {command.vy:.3f}) m/s, {command.wz:.3f} rad/s: {text}",
                **data,
                mode=mode,
                plan=local,
            )
        return local

    def _all_columns(self, checked: ScoreTable) -> ScoreTable:
        """The table of the collision check with a column for each of the planner's critics."""
        costs = np.full((1, len(self._names)), np.nan)
        rejected_by = checked.rejected_by.copy()
        if self._collision_check in self.critics:
            column = self.critics.index(self._collision_check)
            costs[0, column] = checked.costs[0, 0]
            rejected_by[rejected_by == 0] = column
        scales = np.array([critic.scale for critic in self.critics])
        return ScoreTable(costs, scales, checked.totals, rejected_by, checked.best)


def control_period(controller_frequency: float) -> float:
    """Seconds between two commands."""
    return 1.0 / controller_frequency if controller_frequency > 0.0 else DEFAULT_PERIOD_S


def without_speed_limits(limits: VelocityLimits) -> VelocityLimits:
    """Limits without lowest and highest speeds: a braking command may be slower or faster than samples may be."""
    return limits._replace(min_vel_trans=0.0, min_vel_theta=0.0, max_vel_trans=math.inf)


# --- commands at the goal's position: base_local_planner's LatchedStopRotateController -------------------------------


def braking_twist(velocity: Twist2D, limits: VelocityLimits, period: float) -> Twist2D:
    """`velocity` reduced towards zero by one period's deceleration on every axis."""

    def slower(value: float, deceleration: float) -> float:
        return math.copysign(max(0.0, abs(value) - deceleration * period), value)

    return Twist2D(
        slower(velocity.vx, limits.acc_lim_x),
        slower(velocity.vy, limits.acc_lim_y),
        slower(velocity.wz, limits.acc_lim_theta),
    )


def turning_twist(error: float, turning: float, limits: VelocityLimits, period: float, slowest: float) -> Twist2D:
    """A turn in place that reduces the heading error `error` (rad), at the current turning speed `turning` (rad/s).

    The speed equals the error, within one period's acceleration of the current speed and low enough to stop in time. It is
    finally clamped between `slowest`, below which the base would not turn, and the limit.
    """
    fastest = limits.max_vel_theta
    speed = min(fastest, max(slowest, abs(error)))
    change = limits.acc_lim_theta * period
    speed = min(max(speed, abs(turning) - change), abs(turning) + change)
    speed = min(math.sqrt(2.0 * limits.acc_lim_theta * abs(error)), speed)
    speed = min(fastest, max(slowest, speed))
    return Twist2D(0.0, 0.0, -speed if error < 0.0 else speed)
