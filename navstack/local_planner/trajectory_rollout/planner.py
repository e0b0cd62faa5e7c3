"""Trajectory rollout of ROS 1: base_local_planner/TrajectoryPlannerROS, move_base's default local planner.

B. P. Gerkey, K. Konolige, "Planning and Control in Unstructured Terrain", 2008; as in base_local_planner/src/
trajectory_planner.cpp and trajectory_planner_ros.cpp. Simulates samples that accelerate towards their velocity: forward with
a turn, in place, sideways, and as a last resort backward. Flags keep the direction of turns in place until the robot has
moved.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, Footprint, Pose2D, RobotState, Twist2D
from navstack.core.parameters import ParamModel
from navstack.interfaces import ControlInput, Critic, LocalPlan, Rollouts, ScoringContext, VelocityLimits
from navstack.local_planner.goal_checker import LatchingGoalChecker
from navstack.local_planner.map_grid import MapGrid
from navstack.local_planner.sampling_planner import SamplingPlanner, control_period
from navstack.local_planner.scoring import ScoreTable, score
from navstack.local_planner.trajectory_rollout._kernels import distances_ahead, sum_in_order
from navstack.local_planner.trajectory_rollout.critics import (
    GoalDistanceCritic,
    HeadingCritic,
    PathDistanceCritic,
    SimpleAttractorCritic,
    SinglePointCritic,
    UnscaledObstacleCritic,
)
from navstack.local_planner.trajectory_rollout.escape import (
    Additions,
    Escape,
    FullTurnDetector,
    OscillationFlags,
    free_backup_points,
)
from navstack.local_planner.trajectory_rollout.params import TrajectoryPlannerParams, y_speeds
from navstack.local_planner.trajectory_rollout.samples import STRAFE, TrajectoryRolloutGenerator
from navstack.plugins import LOCAL_PLANNERS

STOPPED = 1e-2
"""Speed (m/s, rad/s) up to which the robot counts as stopped: a constant in C++."""


@dataclass(slots=True)
class _Candidates:
    """Scored samples of one cycle."""

    samples: NDArray[np.float64]
    rollouts: Rollouts
    table: ScoreTable

    def legal(self, k: int) -> bool:
        return bool(self.table.rejected_by[k] == -1)


@LOCAL_PLANNERS.register("trajectory_rollout", aliases=("base_local_planner/TrajectoryPlannerROS",))
class TrajectoryPlanner(SamplingPlanner):
    """Follows a plan by trajectory rollout; stops and turns at the goal.

    State between cycles: the plan, whether the goal has been reached, the direction flags, full turns, the escape.
    """

    Params: ClassVar[type[ParamModel]] = TrajectoryPlannerParams
    params: TrajectoryPlannerParams

    def __init__(self, params: TrajectoryPlannerParams) -> None:
        p = params
        per_metre = p.meter_scoring
        obstacle = UnscaledObstacleCritic(p.occdist_scale, per_metre and p.ros_distro == "indigo")
        path = PathDistanceCritic(p.path_distance_bias, per_metre)
        self._goal_distance = GoalDistanceCritic(p.goal_distance_bias, per_metre)
        critics: list[Critic] = [obstacle]
        order = (1, 2, 0)  # C++ adds path, goal, obstacle
        if p.simple_attractor:
            critics.append(SimpleAttractorCritic(p.goal_distance_bias))
            order = (1, 0)
        elif p.heading_scoring:
            inner = (path, self._goal_distance, HeadingCritic())
            critics += [SinglePointCritic(critic, p.heading_scoring_timestep, p.sim_time) for critic in inner]
            order = (0, 1, 3, 2)
        else:
            critics += [path, self._goal_distance]
        self._order = np.array(order)
        self._attractor = p.simple_attractor
        checker = LatchingGoalChecker(
            p.xy_goal_tolerance, p.yaw_goal_tolerance, STOPPED, STOPPED, latch=p.latch_xy_goal_tolerance
        )
        self._y_vels = y_speeds(p.y_vels)
        self._reached = False
        reach = p.max_vel_x * p.sim_time
        self._flags = OscillationFlags()
        self._full_turn = FullTurnDetector(reach)
        self._escape = Escape(p.escape_reset_dist, p.escape_reset_theta, reach)
        self.generator: TrajectoryRolloutGenerator
        generator = TrajectoryRolloutGenerator(p, control_period(p.controller_frequency))
        super().__init__(p, critics, obstacle, checker, generator)
        self.additions = Additions()
        """Rules beyond C++: see docs/parity/trajectory_rollout.md."""

    # --- limits -----------------------------------------------------------------------------------------------------

    def lowered_limits(self, max_vel_trans: float | None, max_vel_theta: float | None) -> VelocityLimits:
        """The limits of the parameters, lowered to these speeds."""
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
        )

    def turning_limits(self) -> tuple[VelocityLimits, float]:
        """The turn at the goal is limited by max_rotational_vel, as in C++, and by lowered limits."""
        p = self.params
        fastest = min(p.max_rotational_vel, self._limits.max_vel_theta)
        return self._limits._replace(max_vel_theta=fastest), min(p.min_in_place_vel_theta, fastest)

    # --- plan and goal ----------------------------------------------------------------------------------------------

    def goal_changed(self) -> None:
        """Reset what belongs to the last goal."""
        super().goal_changed()
        self._reached = False
        self._full_turn.reset()
        self._escape.reset()

    def goal_reached(self, inputs: ControlInput) -> bool:
        """True after a command found position and heading within the tolerances."""
        del inputs
        return self._reached

    def compute_command(self, inputs: ControlInput) -> LocalPlan:
        """Follow the plan, or brake and turn at the goal's position: see `SamplingPlanner`."""
        plan = super().compute_command(inputs)
        self._reached = plan.mode == "arrived"
        return plan

    @property
    def rule(self) -> str:
        """Turns in place are compared by the goal distance ahead of the robot, and are not reversed."""
        forbidden = self._flags.forbidden_turns
        until = f"; turning {' or '.join(forbidden)} is forbidden until it has moved" if forbidden else ""
        return (
            "of the turns in place that cost no more than the best sample ahead, the one that faces a point nearest to the "
            f"goal is selected{until}"
        )

    @property
    def oscillation_flags(self) -> OscillationFlags:
        """Directions that are forbidden until the robot has moved."""
        return self._flags

    @property
    def escaping(self) -> bool:
        """True while only turns in place and backing up are considered."""
        return self._escape.active

    # --- the command ------------------------------------------------------------------------------------------------

    def search(
        self,
        state: RobotState,
        costmap: Costmap,
        footprint: Footprint,
        plan: NDArray[np.float64],
        goal: Pose2D,
    ) -> LocalPlan:
        """Select a sample for following `plan` (n, 3), all in the costmap's frame (TrajectoryPlanner::createTrajectories)."""
        p, limits, generator = self.params, self._limits, self.generator
        state = rounded(state)
        self._goal_distance.step_back = self.additions.nearer_goal
        self._escape.longer = self.additions.longer
        context = self.context(state, costmap, footprint, plan, goal)
        if self._attractor:  # turns in place are compared on this grid all the same
            self._goal_distance.prepare(context)
        bottom, top, right, left = generator.ranges(state, plan, limits)
        turns = generator.turns(right, left)
        forward = np.empty((0, 3)) if self._escape.active else generator.forward(bottom, top, turns, limits)
        candidates = self._scored(context, np.vstack((forward, generator.in_place(turns, limits))))

        best, nearest = _lowest_legal(candidates.table, len(forward)), math.inf
        moved = self._flags.moved(state.pose, p.oscillation_reset_dist)
        circled = self._full_turn.complete(state.pose, moved=moved) and self.additions.full_turns
        if best < 0 or not circled:
            step = (left - right) / (len(turns) - 1) if len(turns) > 1 else math.inf
            best, nearest = self._turn_in_place(best, len(forward), turns, step, candidates)
        if best < 0 and p.holonomic_robot and self._y_vels:
            candidates, best = self._strafe(context, nearest, candidates)
        mode = "follow"
        if best >= 0:
            self._record(candidates.samples[best], state.pose)
        elif p.escape_vel != 0.0:
            candidates, best = self._back_up(context, candidates)
            mode = "escape" if best >= 0 else mode
        if self._flags.moved(state.pose, p.oscillation_reset_dist):
            self._flags.clear()
        self._escape.end_when_done(state.pose)
        command = Twist2D(*candidates.samples[best].tolist()) if best >= 0 else Twist2D()
        t = candidates.table
        chosen = ScoreTable(t.costs, t.scales, t.totals, t.rejected_by, best)
        return self.result(command, candidates.samples, chosen, candidates.rollouts, context, mode)

    def _scored(self, context: ScoringContext, samples: NDArray[np.float64]) -> _Candidates:
        rollouts = self.generator.simulate(samples, context.state, self._limits)
        table = score(self.critics, context, rollouts)
        sum_in_order(table.costs, table.scales, self._order, table.rejected_by, table.totals)
        return _Candidates(samples, rollouts, table)

    def _distances_ahead(self, rollouts: Rollouts, first: int) -> NDArray[np.float64]:
        """Goal distance (cells) heading_lookahead ahead of the end of each rollout from `first` on; negative off the map."""
        grid = self._goal_distance.grid
        if not isinstance(grid, MapGrid):
            raise RuntimeError("prepare was not called")
        ahead = np.empty(len(rollouts.counts) - first)
        distances_ahead(
            grid.grid, grid.storage, rollouts.poses, rollouts.counts, first, self.params.heading_lookahead, ahead
        )
        return ahead

    def _turn_in_place(
        self, best: int, first: int, turns: NDArray[np.float64], step: float, candidates: _Candidates
    ) -> tuple[int, float]:
        """Among the turns in place that cost no more than `best`, the one that faces a point nearest to the goal.

        `first`: row of the first turn. `step`: difference of two turns (rad/s). Returns the row and its goal distance.
        """
        ahead = self._distances_ahead(candidates.rollouts, first).tolist()
        table = candidates.table
        totals, rejected_by = table.totals[first:].tolist(), table.rejected_by[first:].tolist()
        nearest = math.inf
        # a sample that strafes costs more than any turn
        limit = float(table.totals[best]) if best >= 0 and candidates.samples[best, 1] == 0.0 else math.inf
        for i, turn in enumerate(turns.tolist()):
            if rejected_by[i] != -1 or abs(turn) <= step or totals[i] > limit:
                continue
            if 0.0 <= ahead[i] < nearest and self._flags.turn.allows(turn):
                best, nearest, limit = first + i, ahead[i], totals[i]
        return best, nearest

    def _strafe(self, context: ScoringContext, nearest: float, candidates: _Candidates) -> tuple[_Candidates, int]:
        """Add sideways samples; select the one that faces a point nearest to the goal, of those that cost least."""
        first = len(candidates.samples)
        sideways = np.zeros((len(self._y_vels), 3))
        sideways[:, 1] = np.clip(self._y_vels, self._limits.min_vel_y, self._limits.max_vel_y)
        candidates = self._scored(context, np.vstack((candidates.samples, sideways)))
        ahead = self._distances_ahead(candidates.rollouts, first)
        totals = candidates.table.totals
        best = -1
        for i in range(len(sideways)):
            k = first + i
            if not candidates.legal(k) or (best >= 0 and totals[k] > totals[best]):
                continue
            if 0.0 <= ahead[i] < nearest and self._flags.strafe.allows(float(candidates.samples[k, 1])):
                best, nearest = k, float(ahead[i])
        return candidates, best

    def _back_up(self, context: ScoringContext, candidates: _Candidates) -> tuple[_Candidates, int]:
        """Add the escape; select it if it is legal or comes no nearer to obstacles."""
        p = self.params
        speed = max(p.escape_vel, self._limits.min_vel_x)
        candidates = self._scored(context, np.vstack((candidates.samples, [(speed, 0.0, 0.0)])))
        last, rollouts = len(candidates.samples) - 1, candidates.rollouts
        if not self.additions.unreachable and self._without_goal(last, candidates):
            return candidates, -1
        if candidates.legal(last) or not self.additions.check:
            points = int(rollouts.counts[last])
        else:
            points = free_backup_points(context, rollouts, p.escape_reset_dist)
        if not points:
            self._escape.stop()  # the next cycle considers all samples again
            return candidates, -1
        rollouts.counts[last] = min(rollouts.counts[last], points)  # the part that was checked
        self._escape.begin(context.state.pose)
        return candidates, last

    def _without_goal(self, row: int, candidates: _Candidates) -> bool:
        """True if C++ rejects a rollout because a point before its first collision has no way to the plan or the goal."""
        if self.critics[0].name != "obstacle":
            raise RuntimeError("the first critic must be the obstacle critic")
        hit = candidates.table.rejected_by[row] == 0
        points = int(self._collision_check.first_collision[row]) if hit else int(candidates.rollouts.counts[row])
        if points == 0:
            return False
        rollouts, whole = candidates.rollouts, int(candidates.rollouts.counts[row])
        for critic in self.critics:
            if critic.name not in ("path", "goal"):
                continue
            single = isinstance(critic, SinglePointCritic)
            if single and not 0 <= critic.point(whole) < points:
                continue
            counts = np.zeros_like(rollouts.counts)
            counts[row] = whole if single else points
            if critic.score(Rollouts(rollouts.commands, rollouts.poses, counts))[row] < 0.0:
                return True
        return False

    def _record(self, sample: NDArray[np.float64], pose: Pose2D) -> None:
        """Keep a direction other than forward until the robot has moved."""
        if sample[0] <= 0.0:
            if sample[2] != 0.0:
                self._full_turn.begin(pose)
            self._flags.update(sample, pose)


def rounded(state: RobotState) -> RobotState:
    """Pose and velocity as float32, in which TrajectoryPlanner::findBestPath holds them."""
    x, y, yaw, vx, vy, wz = np.array((*state.pose, *state.velocity), np.float32).tolist()
    return state._replace(pose=Pose2D(x, y, yaw), velocity=Twist2D(vx, vy, wz))


def _lowest_legal(table: ScoreTable, number: int) -> int:
    """Index of the lowest total among the first `number` samples that are legal, -1 if none is."""
    legal = table.rejected_by[:number] == -1
    return int(np.where(legal, table.totals[:number], np.inf).argmin()) if legal.any() else -1
