"""Trajectory rollout of ROS 1: base_local_planner/TrajectoryPlannerROS, move_base's default local planner.

B. P. Gerkey, K. Konolige, "Planning and Control in Unstructured Terrain", 2008; as in base_local_planner/src/
trajectory_planner.cpp and trajectory_planner_ros.cpp. Simulates samples that accelerate toward their velocity: forward with
a turn, in place, sideways, and as a last resort backward. The robot that turns in place turns on: left/right flags hold
until it has moved.
"""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, Footprint, Pose2D, RobotState, Twist2D
from navstack.core.parameters import ParamModel
from navstack.interfaces import ControlInput, Critic, LocalPlan, Rollouts, ScoringContext, VelocityLimits
from navstack.local_planner.goal_checker import GoalChecker
from navstack.local_planner.rollouts import RolloutCells
from navstack.local_planner.sampling_planner import SamplingPlanner
from navstack.local_planner.scoring import ScoreTable, score
from navstack.local_planner.trajectory_rollout.critics import (
    GoalDistanceCritic,
    HeadingCritic,
    PathDistanceCritic,
    SimpleAttractorCritic,
    SinglePointCritic,
    UnscaledObstacleCritic,
    one_point,
)
from navstack.local_planner.trajectory_rollout.escape import Escape, FullTurnDetector, backup_points
from navstack.local_planner.trajectory_rollout.oscillation import OscillationFlags
from navstack.local_planner.trajectory_rollout.params import TrajectoryPlannerParams, y_speeds
from navstack.local_planner.trajectory_rollout.samples import STRAFE, TrajectoryRolloutGenerator
from navstack.plugins import LOCAL_PLANNERS

STOPPED = 1e-2
"""Slower than this (m/s, rad/s) counts as stopped: a constant in C++."""


@LOCAL_PLANNERS.register("trajectory_rollout", aliases=("base_local_planner/TrajectoryPlannerROS",))
class TrajectoryPlanner(SamplingPlanner):
    """Follows a plan by trajectory rollout; stops and turns at the goal.

    Stateful between cycles: the plan, whether the goal has been reached, the turning and strafing flags, the escape.
    """

    Params: ClassVar[type[ParamModel]] = TrajectoryPlannerParams
    params: TrajectoryPlannerParams

    def __init__(self, params: TrajectoryPlannerParams) -> None:
        p = params
        per_metre = p.meter_scoring
        obstacle = UnscaledObstacleCritic(p.occdist_scale, per_metre and p.ros_distro == "indigo")
        path = PathDistanceCritic(p.path_distance_bias, per_metre)
        self._to_goal = GoalDistanceCritic(p.goal_distance_bias, per_metre)
        critics: list[Critic] = [obstacle]
        if p.simple_attractor:
            critics.append(SimpleAttractorCritic(p.goal_distance_bias))
        elif p.heading_scoring:
            critics += [
                SinglePointCritic(c, p.heading_scoring_timestep, p.sim_time)
                for c in (path, self._to_goal, HeadingCritic())
            ]
        else:
            critics += [path, self._to_goal]
        super().__init__(
            p,
            critics,
            obstacle,
            GoalChecker(p.xy_goal_tolerance, p.yaw_goal_tolerance, STOPPED, STOPPED),
            latch=p.latch_xy_goal_tolerance,
            prune=p.prune_plan,
            controller_frequency=p.controller_frequency,
        )
        self._y_vels = y_speeds(p.y_vels)
        self.set_limits()
        self._sampler = TrajectoryRolloutGenerator(p, self._period)
        self._reached = False
        farthest = p.max_vel_x * p.sim_time
        self._directions = OscillationFlags()
        self._circles = FullTurnDetector(farthest)
        self._escape = Escape(p.escape_reset_dist, p.escape_reset_theta, farthest)

    # --- limits -----------------------------------------------------------------------------------------------------

    def limits_of(self, max_vel_trans: float | None, max_vel_theta: float | None) -> VelocityLimits:
        p = self.params
        trans = math.inf if max_vel_trans is None else max_vel_trans
        theta = max(p.max_vel_theta, -p.min_vel_theta) if max_vel_theta is None else max_vel_theta
        theta = min(theta, max(p.max_vel_theta, -p.min_vel_theta))
        x = min(p.max_vel_x, trans)
        side = [min(abs(v), trans) for v in (*self._y_vels, STRAFE)] if p.holonomic_robot else [0.0]
        return VelocityLimits(
            max_vel_x=x,
            min_vel_x=max(min(p.min_vel_x, x, p.escape_vel), -trans),
            max_vel_y=max(side),
            min_vel_y=-max(side),
            max_vel_trans=max(x, math.hypot(min(STRAFE, x), min(STRAFE, trans)), *side, min(abs(p.escape_vel), trans))
            if max_vel_trans is None
            else max_vel_trans,
            min_vel_trans=min(p.min_vel_x, x),
            max_vel_theta=theta,
            min_vel_theta=min(p.min_in_place_vel_theta, theta),
            acc_lim_x=p.acc_lim_x,
            acc_lim_y=p.acc_lim_y,
            acc_lim_theta=p.acc_lim_theta,
            yaw_goal_tolerance=p.yaw_goal_tolerance,
            xy_goal_tolerance=p.xy_goal_tolerance,
        )

    def turning_limits(self) -> tuple[VelocityLimits, float]:
        """The turn at the goal is limited by max_rotational_vel alone, as in C++, and by limits that were lowered."""
        p = self.params
        fastest = p.max_rotational_vel
        if self._limits.max_vel_theta < max(p.max_vel_theta, -p.min_vel_theta):
            fastest = min(fastest, self._limits.max_vel_theta)
        fastest = min(fastest, self._limits.max_vel_theta)
        return self._limits._replace(max_vel_theta=fastest), min(p.min_in_place_vel_theta, fastest)

    # --- plan and goal ----------------------------------------------------------------------------------------------

    def plan_changed(self, *, same_goal: bool) -> None:
        """A new goal has not been reached."""
        if not same_goal:
            self._reached = False
            self._circles.forget()
            self._escape.forget()

    def goal_reached(self, inputs: ControlInput) -> bool:
        """True once a command found position and heading within the tolerances."""
        del inputs
        return self._reached

    def compute_command(self, inputs: ControlInput) -> LocalPlan:
        """One cycle: follow the plan, or brake and turn at the goal's position.

        Raises InvalidPathError when no part of the plan is near, NoValidControlError when every sample is rejected.
        """
        plan = super().compute_command(inputs)
        self._reached = plan.mode == "arrived"
        return plan

    @property
    def rule(self) -> str:
        """Turns in place are weighed by where they look to, and not taken back."""
        closed = self._directions.closed
        until = f"; turning {' or '.join(closed)} is closed until it has moved" if closed else ""
        return (
            "of the turns in place that cost no more than the best sample ahead, the one that looks nearest to the goal "
            f"wins{until}"
        )

    def simulated(self, command: Twist2D, state: RobotState) -> Rollouts:
        """The one trajectory of a command at the goal."""
        return self._sampler.run(np.array([command]), state, self._limits)

    # --- the command ------------------------------------------------------------------------------------------------

    def search(
        self,
        state: RobotState,
        costmap: Costmap,
        footprint: Footprint,
        plan: NDArray[np.float64],
        goal: Pose2D,
    ) -> LocalPlan:
        """The best sample for following `plan` (n, 3), all in the costmap's frame (TrajectoryPlanner::createTrajectories)."""
        p, limits, sampler = self.params, self._limits, self._sampler
        context = self.context(state, costmap, footprint, plan, goal)
        bottom, top, right, left = sampler.ranges(state, plan, limits)
        turns = sampler.turns(right, left)
        forward = np.empty((0, 3)) if self._escape.active else sampler.forward(bottom, top, turns, limits)
        samples = np.vstack((forward, sampler.in_place(turns, limits)))
        rollouts = sampler.run(samples, state, limits)
        table = score(self.critics, context, rollouts)

        totals, legal = table.totals, table.rejected_by == -1
        best = -1
        if len(forward) and legal[: len(forward)].any():
            best = int(np.where(legal[: len(forward)], totals[: len(forward)], np.inf).argmin())
        nearest = math.inf
        moved = self._directions.moved(state.pose, p.oscillation_reset_dist)
        if best < 0 or not self._circles.complete(state.pose, moved=moved):
            step = (left - right) / (len(turns) - 1) if len(turns) > 1 else math.inf
            best, nearest = self._turn_in_place(best, nearest, len(forward), turns, step, table, rollouts, legal)
        mode = "follow"
        if best < 0 and p.holonomic_robot and self._y_vels:
            first = len(samples)
            sideways = np.zeros((len(self._y_vels), 3))
            sideways[:, 1] = np.clip(self._y_vels, limits.min_vel_y, limits.max_vel_y)
            samples, rollouts, table = self._more(context, samples, sideways)
            best = self._strafe(first, nearest, table, rollouts)
        if best >= 0:
            self._take_note(samples[best], state.pose)
        elif p.escape_vel != 0.0:
            escape = np.array([(max(p.escape_vel, limits.min_vel_x), 0.0, 0.0)])
            samples, rollouts, table = self._more(context, samples, escape)
            free = table.rejected_by[-1] == -1
            points = int(rollouts.counts[-1]) if free else backup_points(context, rollouts, p.escape_reset_dist)
            if points:
                best = len(samples) - 1
                mode = "escape"
                rollouts.counts[-1] = min(rollouts.counts[-1], points)  # what was checked
                self._escape.begin(state.pose)
            else:
                self._escape.stop()  # no farther: the next cycle tries everything again
        if self._directions.moved(state.pose, p.oscillation_reset_dist):
            self._directions.clear()
        self._escape.end_when_done(state.pose)
        command = Twist2D(*samples[best].tolist()) if best >= 0 else Twist2D()
        chosen = ScoreTable(table.costs, table.scales, table.totals, table.rejected_by, best)
        return self.result(command, samples, chosen, rollouts, context, mode)

    def _more(
        self, context: ScoringContext, samples: NDArray[np.float64], added: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], Rollouts, ScoreTable]:
        """The table again with further samples, tried only because nothing before was legal."""
        samples = np.vstack((samples, added))
        rollouts = self._sampler.run(samples, context.state, self._limits)
        return samples, rollouts, score(self.critics, context, rollouts)

    def _ahead(self, rollouts: Rollouts, rows: slice) -> NDArray[np.float64]:
        """Goal distance (cells) seen heading_lookahead ahead of each trajectory's end; negative off the map."""
        part = Rollouts(rollouts.samples[rows], rollouts.poses[rows], rollouts.counts[rows])
        ends = one_point(part, part.counts - 1)
        grid = self._to_goal.grid
        k = len(ends.counts)
        if grid is None:  # simple_attractor builds none
            return np.zeros(k)
        alive = np.ones(k, np.bool_)
        cells = RolloutCells().compute(ends, grid.costmap.geometry)
        return grid.at_nose(ends, cells, alive, self.params.heading_lookahead, np.empty(k))

    def _turn_in_place(
        self,
        best: int,
        nearest: float,
        first: int,
        turns: NDArray[np.float64],
        step: float,
        table: ScoreTable,
        rollouts: Rollouts,
        legal: NDArray[np.bool_],
    ) -> tuple[int, float]:
        """Takes turns in place in: of those at least as good as what there is, the one that looks nearest to the goal."""
        ahead = self._ahead(rollouts, slice(first, None))
        totals, samples = table.totals, rollouts.samples
        for i, turn in enumerate(turns.tolist()):
            k = first + i
            if not legal[k] or abs(turn) <= step:
                continue
            if best >= 0 and totals[k] > totals[best] and samples[best, 1] == 0.0:
                continue
            if 0.0 <= ahead[i] < nearest and self._directions.turn.allows(turn):
                best, nearest = k, float(ahead[i])
        return best, nearest

    def _strafe(self, first: int, nearest: float, table: ScoreTable, rollouts: Rollouts) -> int:
        """The sideways sample that looks nearest to the goal, among those as good as the best before it."""
        ahead = self._ahead(rollouts, slice(first, None))
        best = -1
        for i in range(len(table.totals) - first):
            k = first + i
            if table.rejected_by[k] != -1 or (best >= 0 and table.totals[k] > table.totals[best]):
                continue
            if 0.0 <= ahead[i] < nearest and self._directions.strafe.allows(float(rollouts.samples[k, 1])):
                best, nearest = k, float(ahead[i])
        return best

    def _take_note(self, sample: NDArray[np.float64], pose: Pose2D) -> None:
        """A way other than forward is kept to until the robot has moved."""
        if sample[0] <= 0.0:
            if sample[2] != 0.0:
                self._circles.begin(pose)
            self._directions.note(sample, pose)
