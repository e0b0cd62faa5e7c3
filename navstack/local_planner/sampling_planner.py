"""What DWA and trajectory rollout have in common: the plan, the goal, the latch, braking and turning at the goal."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, Footprint, Path, Pose2D, RobotState, Twist2D
from navstack.core.errors import ControlError, InvalidPathError, NoValidControlError
from navstack.interfaces import (
    ControlInput,
    Critic,
    LocalPlan,
    LocalPlanner,
    Rollouts,
    ScoringContext,
    VelocityLimits,
)
from navstack.local_planner.critics.obstacle import ObstacleCritic
from navstack.local_planner.goal_checker import GoalChecker
from navstack.local_planner.map_grid import MapGrid
from navstack.local_planner.path_handler import PathHandler
from navstack.local_planner.rejection_report import rejection_details, rejection_report
from navstack.local_planner.rollouts import RolloutCells
from navstack.local_planner.scoring import ScoreTable, score
from navstack.local_planner.stop_rotate import braking_twist, turning_twist

DEFAULT_PERIOD_S = 0.05
"""The control period without a controller_frequency."""
SAME_GOAL = 1e-6
"""Goals nearer than this (m, rad) are one goal."""


class SamplingPlanner(LocalPlanner):
    """Follows a plan by `search`; at the goal's position brakes, then turns in place.

    Stateful between cycles: the plan, whether the goal's position has been reached.
    """

    def __init__(
        self,
        params: Any,
        critics: list[Critic],
        guard: ObstacleCritic,
        checker: GoalChecker,
        *,
        latch: bool,
        prune: bool,
        controller_frequency: float,
    ) -> None:
        super().__init__(params)
        self.critics = critics
        self.checker = checker
        self._names = tuple(critic.name for critic in critics)
        self._guard = guard
        self._latch = latch
        self._prune = prune
        self._period = 1.0 / controller_frequency if controller_frequency > 0.0 else DEFAULT_PERIOD_S
        self._plan = PathHandler()
        self._cells = RolloutCells()
        self._goal: Pose2D | None = None
        self._latched = False
        self._rotating = False
        self._limits: VelocityLimits
        self._last: tuple[ScoringContext, Rollouts, ScoreTable, LocalPlan] | None = None

    @property
    def period(self) -> float:
        """Seconds between two commands."""
        return self._period

    # --- limits -----------------------------------------------------------------------------------------------------

    @property
    def limits(self) -> VelocityLimits:
        """The limits in force."""
        return self._limits

    def set_limits(self, *, max_vel_trans: float | None = None, max_vel_theta: float | None = None) -> None:
        """Lowers the speed limits (m/s, rad/s) until called again; None restores that of the parameters."""
        for name, value in (("max_vel_trans", max_vel_trans), ("max_vel_theta", max_vel_theta)):
            if value is not None and not (math.isfinite(value) and value >= 0.0):
                raise ControlError(f"{name} must be a speed of at least 0, not {value}", limit=name, value=value)
        self._limits = self.limits_of(max_vel_trans, max_vel_theta)

    @abstractmethod
    def limits_of(self, max_vel_trans: float | None, max_vel_theta: float | None) -> VelocityLimits:
        """Those of the parameters, with lower ones in place (None: not lowered)."""

    # --- plan and goal ----------------------------------------------------------------------------------------------

    def set_plan(self, plan: Path, goal: Pose2D) -> None:
        """Follow `plan` to `goal`. With the goal of before it is a replan: the latch holds."""
        if not goal.is_finite():
            raise ControlError(f"the goal is not finite: {tuple(goal)}", goal=list(goal))
        self._plan.set(plan)
        before = self._goal
        self._goal = Pose2D(*goal)
        # ROS differs: there every replan forgets that the position was reached (parity 17)
        same = before is not None and all(abs(a - b) <= SAME_GOAL for a, b in zip(before, goal))
        if not same:
            self._latched = False
            self._rotating = False
        self.plan_changed(same_goal=same)

    def plan_changed(self, *, same_goal: bool) -> None:
        """Called after a plan was set."""
        del same_goal

    def command_checked(self) -> None:
        """Called before a command at the goal is checked."""

    def at_position(self, pose: Pose2D, goal: Pose2D) -> bool:
        """At the goal's position, or there before and latched. Takes note of it."""
        if self._latch and self._latched:
            return True
        if self.checker.at_position(pose, goal):
            self._latched = True
            return True
        return False

    # --- the command ------------------------------------------------------------------------------------------------

    def compute_command(self, inputs: ControlInput) -> LocalPlan:
        """One cycle: follow the plan, or brake and turn at the goal's position.

        Raises InvalidPathError when no part of the plan is near, NoValidControlError when every sample is rejected.
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
            raise InvalidPathError("there is no plan to follow: call set_plan first", poses=0)
        plan = self._plan.in_sight(state.pose, inputs.plan_to_costmap, inputs.costmap.geometry, prune=self._prune)
        goal = inputs.plan_to_costmap.apply(self._goal)
        if self.at_position(state.pose, goal):
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
        """The best sample for following `plan` (n, 3), all in the costmap's frame; raises NoValidControlError."""

    @abstractmethod
    def simulated(self, command: Twist2D, state: RobotState) -> Rollouts:
        """The one trajectory of a command at the goal, however slow it is."""

    def turning_limits(self) -> tuple[VelocityLimits, float]:
        """Limits of the turn at the goal, and its lowest speed (rad/s)."""
        return self.limits, self.limits.min_vel_theta

    def context(
        self, state: RobotState, costmap: Costmap, footprint: Footprint, plan: NDArray[np.float64], goal: Pose2D
    ) -> ScoringContext:
        """What critics see, with a costmap whose array the kernels are compiled for."""
        flags = costmap.data.flags
        if not (flags.c_contiguous and flags.writeable):  # a view, or read-only
            costmap = costmap.copy()
        self._cells.forget()
        return ScoringContext(state, costmap, footprint, plan, goal, self.limits, {"cells": self._cells})

    def result(
        self,
        command: Twist2D,
        samples: NDArray[np.float64],
        table: ScoreTable,
        rollouts: Rollouts,
        context: ScoringContext,
        mode: str = "follow",
    ) -> LocalPlan:
        """The command with its table; raises NoValidControlError with the table when no sample is legal."""
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
            tuple(context.shared.get("notes", ())),
        )
        self._last = context, rollouts, table, plan
        if best < 0:
            text, data = rejection_report(
                table, self.critics, rollouts, samples, context.costmap, context.footprint, self.limits.max_vel_trans
            )
            raise NoValidControlError(text, **data, plan=plan)
        return plan

    def explain(self, inputs: ControlInput) -> dict[str, Any]:
        """What `explain_last` says, of the last search whatever `inputs` are."""
        del inputs
        return self.explain_last()

    def explain_last(self) -> dict[str, Any]:
        """Of the last search, legal or not; empty before the first and where the robot has arrived.

        `plan` the LocalPlan with its table, `poses` (K, T, 3), `counts` (K,), `commands` (K, 3), `first_collision` (K,), `grids`
        by critic, `costmap` and `footprint` as the critics saw them, `rejections` in a sentence, `accounts`: per sample what
        rejected it and where, `rule`: how the planner chooses, where that is not simply the lowest total.
        """
        if self._last is None:
            return {}
        context, rollouts, table, plan = self._last
        critics = self.critics if plan.mode in ("follow", "escape") else [self._guard]
        samples = plan.samples if plan.samples is not None else rollouts.samples
        fastest = self.limits.max_vel_trans
        text, _ = rejection_report(table, critics, rollouts, samples, context.costmap, context.footprint, fastest)
        grids: dict[str, NDArray[np.float64]] = {}
        for critic in self.critics:
            grid = getattr(critic, "grid", None)
            if isinstance(grid, MapGrid):
                grids[critic.name] = grid.values()
        return {
            "poses": rollouts.poses.copy(),
            "counts": rollouts.counts.copy(),
            "commands": rollouts.samples.copy(),
            "first_collision": self._guard.first_collision.copy(),
            "grids": grids,
            "plan": plan,
            "costmap": context.costmap,
            "footprint": context.footprint,
            "rejections": text,
            "accounts": rejection_details(table, critics, rollouts, context.costmap, context.footprint, fastest),
            "rule": self.rule,
        }

    @property
    def rule(self) -> str:
        """How the winner is chosen, where that is not simply the lowest total."""
        return ""

    # --- at the goal's position -------------------------------------------------------------------------------------

    def _stop_and_rotate(self, inputs: ControlInput, plan: NDArray[np.float64], goal: Pose2D) -> LocalPlan:
        state = inputs.state
        if self.checker.at_heading(state.pose, goal):
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
        if not self._rotating and not self.checker.stopped(state.velocity):
            mode, doing = "brake", "braking"
            command = braking_twist(state.velocity, self.limits, self._period)
        else:
            self._rotating = True
            mode, doing = "rotate_to_goal", "turning in place"
            limits, slowest = self.turning_limits()
            error = self.checker.yaw_error(state.pose, goal)
            command = turning_twist(error, state.velocity.wz, limits, self._period, slowest)
        return self._checked(command, mode, doing, inputs, plan, goal)

    def _checked(
        self, command: Twist2D, mode: str, doing: str, inputs: ControlInput, plan: NDArray[np.float64], goal: Pose2D
    ) -> LocalPlan:
        """`command` if its trajectory hits nothing."""
        self.command_checked()
        context = self.context(inputs.state, inputs.costmap, inputs.footprint, plan, goal)
        samples = np.array([command])
        rollouts = self.simulated(command, inputs.state)
        if rollouts.counts[0] == 0:  # standing: the present pose is what can be checked
            rollouts.counts[0] = 1
            rollouts.poses[0, 0] = inputs.state.pose
        table = score([self._guard], context, rollouts)
        costs = np.full((1, len(self._names)), np.nan)
        rejected_by = table.rejected_by.copy()
        if self._guard in self.critics:
            place = self.critics.index(self._guard)
            costs[0, place] = table.costs[0, 0]
            rejected_by[rejected_by == 0] = place
        legal = table.best >= 0
        local = LocalPlan(
            command if legal else Twist2D(),
            mode,
            samples,
            self._names,
            costs,
            np.array([critic.scale for critic in self.critics]),
            table.totals,
            rejected_by,
            table.best,
            rollouts.poses[0, : rollouts.counts[0]].copy() if legal else None,
            Path(plan, context.costmap.frame),
        )
        self._last = context, rollouts, table, local
        if not legal:
            text, data = rejection_report(
                table,
                [self._guard],
                rollouts,
                samples,
                context.costmap,
                inputs.footprint,
                self.limits.max_vel_trans,
            )
            raise NoValidControlError(
                f"{doing} at the goal at ({command.vx:.3f}, {command.vy:.3f}) m/s, {command.wz:.3f} rad/s: {text}",
                **data,
                mode=mode,
                plan=local,
            )
        return local


def at_least_standing(limits: VelocityLimits) -> VelocityLimits:
    """Without lowest and highest speeds: a brake may be slower, or faster, than samples may be."""
    return limits._replace(min_vel_trans=0.0, min_vel_theta=0.0, max_vel_trans=math.inf)
