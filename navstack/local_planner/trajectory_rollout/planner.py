# pyright: basic
"""Trajectory rollout of ROS 1: base_local_planner/TrajectoryPlannerROS, move_base's default local planner.

B. P. Gerkey, K. Konolige, "Planning and Control in Unstructured Terrain", 2008; as in base_local_planner/src/
trajectory_planner.cpp and trajectory_planner_ros.cpp. Simulates samples that accelerate towards their velocity: forward with
a turn, in place, sideways, and as a last resort backward. Flags keep the direction of turns in place until the robot has
moved.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import field_validator

from navstack.core import Costmap, Footprint, Pose2D, RobotState, Twist2D, kernel, plain_kernel
from navstack.local_planner import parameter_checks as checks
from navstack.local_planner.goal_checkers import LatchingGoalChecker
from navstack.local_planner.map_grid import STATE_SIZE, MapGrid, RosDistro, grid_value
from navstack.local_planner.rollouts import check_points
from navstack.local_planner.sampling_planner import SamplingPlanner, control_period
from navstack.local_planner.scoring import ScoreTable, score
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
from navstack.plugins import (
    LOCAL_PLANNERS,
    CheckContext,
    ControlInput,
    Critic,
    Issue,
    LocalPlan,
    ParamModel,
    Rollouts,
    ScoringContext,
    TrajectoryGenerator,
    VelocityLimits,
    param,
)

# ----------------------------------------------------------------------------------------------------------------------
# Parameters of TrajectoryPlannerROS.


class TrajectoryPlannerParams(ParamModel):
    """Parameters of TrajectoryPlannerROS (trajectory_planner_ros.cpp, base_local_planner/cfg/BaseLocalPlanner.cfg)."""

    RENAMED: ClassVar[Mapping[str, str]] = {
        "pdist_scale": "path_distance_bias",
        "gdist_scale": "goal_distance_bias",
        "min_in_place_rotational_vel": "min_in_place_vel_theta",
        "backup_vel": "escape_vel",
        "acc_limit_x": "acc_lim_x",
        "acc_limit_y": "acc_lim_y",
        "acc_limit_th": "acc_lim_theta",
        "acc_lim_th": "acc_lim_theta",
        "vth_samples": "vtheta_samples",
    }
    NO_EFFECT: ClassVar[Mapping[str, str]] = {
        "stop_time_buffer": "its use is commented out in ROS",
        "world_model": 'ROS supports only "costmap"',
        "point_grid": "belongs to a world model that ROS has removed",
        "restore_defaults": "a button of dynamic_reconfigure",
        "publish_cost_grid_pc": "ROS does not read it: cost_cloud is always published",
        "global_frame_id": "ROS does not read it: cost_cloud is in the costmap's frame",
        "max_vel_y": "y_vels has the sideways speeds",
        "min_vel_y": "y_vels has the sideways speeds",
    }
    SEARCHED: ClassVar[frozenset[str]] = frozenset({"controller_frequency"})
    FROM_NAVSTACK: ClassVar[frozenset[str]] = frozenset({"ros_distro"})

    CLAMPED: ClassVar[frozenset[str]] = frozenset(
        {
            "acc_lim_x",
            "acc_lim_y",
            "acc_lim_theta",
            "max_vel_x",
            "min_vel_x",
            "max_vel_theta",
            "min_vel_theta",
            "min_in_place_vel_theta",
            "sim_time",
            "sim_granularity",
            "angular_sim_granularity",
            "vx_samples",
            "vtheta_samples",
            "path_distance_bias",
            "goal_distance_bias",
            "occdist_scale",
            "heading_lookahead",
            "oscillation_reset_dist",
            "escape_reset_dist",
            "escape_reset_theta",
            "escape_vel",
            "heading_scoring_timestep",
        }
    )
    acc_lim_x: float = param(2.5, "acceleration along x", unit="m/s²", ge=0.0, le=20.0)
    acc_lim_y: float = param(2.5, "acceleration along y", unit="m/s²", ge=0.0, le=20.0)
    acc_lim_theta: float = param(3.2, "turning acceleration", unit="rad/s²", ge=0.0, le=20.0)
    max_vel_x: float = param(0.55, "highest forward speed", unit="m/s", ge=0.0, le=20.0)
    min_vel_x: float = param(0.0, "lowest forward speed", unit="m/s", ge=0.0, le=20.0)
    max_vel_theta: float = param(1.0, "highest turning speed, to the left", unit="rad/s", ge=0.0, le=20.0)
    min_vel_theta: float = param(-1.0, "highest turning speed to the right, negative", unit="rad/s", ge=-20.0, le=0.0)
    max_rotational_vel: float = param(1.0, "highest speed of the turn at the goal", unit="rad/s", ge=0.0)
    min_in_place_vel_theta: float = param(0.4, "lowest speed of a turn in place", unit="rad/s", ge=0.0, le=20.0)
    sim_time: float = param(1.7, "duration of the simulated trajectories", unit="s", gt=0.0, le=10.0)
    sim_granularity: float = param(0.025, "distance between the points of a trajectory", unit="m", gt=0.0, le=5.0)
    angular_sim_granularity: float = param(
        0.025, "turn between the points of a trajectory", unit="rad", gt=0.0, le=math.pi / 2
    )
    vx_samples: int = param(20, "number of forward speeds", ge=1, le=300)
    vtheta_samples: int = param(20, "number of turning speeds", ge=1, le=300)
    path_distance_bias: float = param(0.6, "weight of the distance to the plan", ge=0.0, le=5.0)
    goal_distance_bias: float = param(0.8, "weight of the distance to the local goal", ge=0.0, le=5.0)
    occdist_scale: float = param(0.01, "weight of the obstacle cost", ge=0.0, le=5.0)
    meter_scoring: bool = param(
        False,
        "measure distances in meters instead of cells",
        ros_differs="if unset, it is an uninitialized bool there; here it is false",
    )
    heading_lookahead: float = param(
        0.325, "distance ahead of the robot at which turns in place are compared", unit="m", ge=0.0, le=5.0
    )
    oscillation_reset_dist: float = param(
        0.05, "motion that allows turning in the other direction", unit="m", ge=0.0, le=5.0
    )
    escape_reset_dist: float = param(
        0.1,
        "motion that ends an escape",
        unit="m",
        ge=0.0,
        le=5.0,
        ros_differs="there every escape ends after this distance, often forever between two poses; here each escape from the "
        "same place leads twice as far as the one before, and only where it comes no nearer to an obstacle",
    )
    escape_reset_theta: float = param(math.pi / 2, "turn that ends an escape", unit="rad", ge=0.0, le=5.0)
    escape_vel: float = param(-0.1, "speed of an escape backward, negative", unit="m/s", ge=-2.0, le=2.0)
    holonomic_robot: bool = param(True, "sample sideways motion")
    y_vels: str | list[float] = param(
        "-0.3,-0.1,0.1,-0.3", "sideways speeds of a holonomic robot: a list, or a string with commas", unit="m/s"
    )
    dwa: bool = param(False, "sample velocities reachable within one period; otherwise within sim_time")
    heading_scoring: bool = param(
        False, "score the heading towards the plan, and distances at one point of the trajectory only"
    )
    heading_scoring_timestep: float = param(0.1, "time of that point along the trajectory", unit="s", ge=0.0, le=1.0)
    simple_attractor: bool = param(False, "score the squared distance to the end of the local plan instead of grids")
    prune_plan: bool = param(True, "drop poses of the plan behind the robot, more than 1 m away")
    yaw_goal_tolerance: float = param(0.05, "angle at which the goal's heading is reached", unit="rad", ge=0.0)
    xy_goal_tolerance: float = param(0.1, "distance at which the goal's position is reached", unit="m", ge=0.0)
    latch_xy_goal_tolerance: bool = param(
        False,
        "once at the goal's position, only turn",
        ros_differs="released by every replan",
    )
    controller_frequency: float = param(20.0, "control cycles per second; 0 counts as 20", unit="Hz", ge=0.0)
    ros_distro: RosDistro = param(
        "noetic",
        "scoring scale of noetic, or of the releases before 2018, which also scaled obstacles with meter_scoring",
    )

    @field_validator("y_vels")
    @classmethod
    def _speeds(cls, value: str | list[float]) -> str | list[float]:
        y_speeds(value)
        return value

    def check(self, context: CheckContext) -> Iterator[Issue]:
        """Yield what keeps the robot from moving, from stopping or from reaching its goal."""
        yield from self._check_scoring_scale(context)
        fastest = checks.Limit("max_vel_x", self.max_vel_x)
        yield from checks.window_too_small(context, self.sim_time, fastest)
        yield from checks.updates_too_slow(context, fastest)
        yield from checks.stopping_time(context, checks.Limit("acc_lim_x", self.acc_lim_x), fastest, self.sim_time)
        yield from checks.coarse_simulation(context, self.sim_granularity, self.sim_time, self.acc_lim_x, fastest)
        yield from checks.minimum_over_maximum(
            [
                ("min_vel_x", self.min_vel_x, "max_vel_x", self.max_vel_x),
                ("min_vel_theta", self.min_vel_theta, "max_vel_theta", self.max_vel_theta),
            ]
        )
        yield from checks.goal_tolerances(context, self.xy_goal_tolerance, self.yaw_goal_tolerance, self.min_vel_theta)
        if self.min_vel_x == 0.0 and self.occdist_scale > 0.0:
            message = (
                "min_vel_x = 0 makes standing still one of the samples, and the cheapest one where a turn in place brings a "
                "corner of the robot to a higher cost, so the robot may stop before a turn; set min_vel_x to 0.1"
            )
            yield Issue("info", "standing-sample", ("min_vel_x",), message, "0.1")

    def _check_scoring_scale(self, context: CheckContext) -> Iterator[Issue]:
        resolution = context.local_costmap.resolution
        obstacle = self.occdist_scale * checks.INSCRIBED_COST
        # indigo scaled obstacles by the resolution with meter_scoring only; without it, distances count cells
        if self.meter_scoring:
            noetic, indigo = (self.goal_distance_bias, obstacle), (self.goal_distance_bias, obstacle * resolution)
        else:
            noetic = indigo = (self.goal_distance_bias / resolution, obstacle)
        return checks.scoring_scale(
            context,
            horizon=self.sim_time * self.max_vel_x,
            goal_distance_bias=self.goal_distance_bias,
            occdist_scale=self.occdist_scale,
            score=indigo if context.ros_distro == "indigo" else noetic,
            indigo_score=indigo,
            factor=1.0 / resolution,
        )


def y_speeds(value: str | Sequence[float]) -> list[float]:
    """Parse `y_vels`: "-0.3,0.3" or [-0.3, 0.3]; raises ValueError."""
    try:
        speeds = [float(v) for v in (value.split(",") if isinstance(value, str) else value) if str(v).strip()]
    except ValueError as exc:
        raise ValueError(f"must be numbers separated by commas, not {value!r}") from exc
    if not all(math.isfinite(v) for v in speeds):
        raise ValueError("must be finite numbers")
    return speeds


# ----------------------------------------------------------------------------------------------------------------------
# Velocity samples of trajectory rollout, and their rollouts (TrajectoryPlanner::createTrajectories).


# pyright: basic


STRAFE = 0.1
"""Speed (m/s) forward and to either side of the two strafing samples of a holonomic robot."""


class TrajectoryRolloutGenerator(TrajectoryGenerator):
    """Samples forward speeds, each straight and with turns, then turns in place."""

    def __init__(self, params: TrajectoryPlannerParams, period: float) -> None:
        """`period`: the control period (s)."""
        self._params = params
        self._period = period

    def samples(self, state: RobotState, plan: NDArray[np.float64], limits: VelocityLimits) -> NDArray[np.float64]:
        """(K, 3) samples that drive forward, then turns in place."""
        return self.speeds(self.ranges(state, plan, limits), limits, forward=True)[0]

    def ranges(
        self, state: RobotState, plan: NDArray[np.float64], limits: VelocityLimits
    ) -> tuple[float, float, float, float]:
        """Lowest and highest vx, lowest and highest wz: reachable, and at most the speed that reaches the plan's end."""
        p = self._params
        distance = math.hypot(plan[-1, 0] - state.pose.x, plan[-1, 1] - state.pose.y)
        horizon = self._period if p.dwa else p.sim_time
        slowest = min(p.min_vel_x, limits.max_vel_x)
        v, w = state.velocity.vx, state.velocity.wz
        top = max(min(limits.max_vel_x, distance / p.sim_time, v + limits.acc_lim_x * horizon), slowest)
        bottom = min(max(slowest, v - limits.acc_lim_x * horizon), limits.max_vel_x)
        left = min(p.max_vel_theta, limits.max_vel_theta)
        right = max(p.min_vel_theta, -limits.max_vel_theta)
        change = limits.acc_lim_theta * horizon
        return bottom, top, min(max(right, w - change), left), max(min(left, w + change), right)

    def speeds(
        self, ranges: tuple[float, float, float, float], limits: VelocityLimits, *, forward: bool
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(K, 3) samples within `ranges`, and the (vtheta_samples,) turning speeds, from right to left.

        With `forward` each forward speed straight, then with every turn but the last; for a holonomic robot two that strafe. The
        last vtheta_samples rows are turns in place of at least the lowest turning speed.
        """
        p = self._params
        strafe = min(STRAFE, limits.max_vel_x)
        strafes = forward and p.holonomic_robot and math.hypot(strafe, STRAFE) <= limits.max_vel_trans
        speeds, turns = p.vx_samples if forward else 0, np.empty(p.vtheta_samples)
        samples = np.empty(((speeds + 1) * len(turns) + (2 if strafes else 0), 3))
        bottom, top, right, left = map(float, ranges)
        turn = float(limits.min_vel_theta)
        write_samples(bottom, top, right, left, float(strafe), turn, speeds, samples, turns)
        return samples, turns

    def simulate(self, samples: NDArray[np.float64], state: RobotState, limits: VelocityLimits) -> Rollouts:
        """Rollouts of `samples` (K, 3), which accelerate towards their sample."""
        p = self._params
        counts = np.empty(len(samples), np.int64)
        longest = count_points(
            samples, p.sim_time, p.sim_granularity, p.angular_sim_granularity, p.heading_scoring, counts
        )
        check_points(len(samples), longest)
        poses = np.empty((len(samples), longest, 3))
        simulate_accelerating(
            samples,
            np.array(state.pose),
            np.array(state.velocity),
            np.array((limits.acc_lim_x, limits.acc_lim_y, limits.acc_lim_theta)),
            p.sim_time,
            counts,
            poses,
        )
        return Rollouts(samples, poses, counts)


# --- kernels --------------------------------------------------------------------------------------------------------

HALF_PI = 0.5 * math.pi


@plain_kernel
def write_samples(bottom, top, right, left, strafe, slowest, speeds, samples, turns):
    """Write the turning speeds from `right` to `left` to `turns` (n,), and the samples (K, 3) of `speeds` forward speeds.

    Each speed is the one before plus the step: rounded as the loop of C++. The n turns in place, the last rows, turn at
    `slowest` (rad/s) at least; rows before them strafe at the forward speed `strafe`.
    """
    n = len(turns)
    turn, step = right, (left - right) / max(n - 1, 1)
    for j in range(n):
        turns[j] = turn
        turn += step
    samples[:] = 0.0
    speed, step = bottom, (top - bottom) / max(speeds - 1, 1)
    for i in range(speeds):
        for j in range(n):
            samples[i * n + j, 0] = speed
            samples[i * n + j, 2] = turns[j - 1] if j > 0 else 0.0
        speed += step
    first = len(samples) - n
    for k in range(speeds * n, first):
        samples[k, 0] = strafe
        samples[k, 1] = STRAFE if k == speeds * n else -STRAFE
    for j in range(n):
        samples[first + j, 2] = max(turns[j], slowest) if turns[j] > 0.0 else min(turns[j], -slowest)


@kernel
def count_points(samples, sim_time, granularity, angular_granularity, by_time, counts):
    """Write the points per rollout, at least 1, to `counts` (K,). Returns the largest count.

    `by_time`: as heading_scoring, the granularity is a time.
    """
    longest = 1
    for k in range(len(samples)):
        if by_time:
            steps = sim_time / granularity
        else:
            along = math.hypot(samples[k, 0], samples[k, 1]) * sim_time / granularity
            steps = max(along, abs(samples[k, 2]) / angular_granularity)
        counts[k] = max(1, int(steps + 0.5))
        longest = max(longest, counts[k])
    return longest


@kernel
def simulate_accelerating(samples, pose, velocity, acceleration, sim_time, counts, poses):
    """Write rollouts that accelerate towards their sample to `poses` (K, T, 3); the first point is `pose`.

    `counts` (K,): points per rollout.
    """
    c, s, at = math.cos(pose[2]), math.sin(pose[2]), pose[2]
    for k in range(len(samples)):
        x, y, yaw = pose[0], pose[1], pose[2]
        vx, vy, vw = velocity[0], velocity[1], velocity[2]
        n = counts[k]
        if n == 0:
            continue
        dt = sim_time / n
        for i in range(n):
            poses[k, i, 0] = x
            poses[k, i, 1] = y
            poses[k, i, 2] = yaw
            vx = approach(vx, samples[k, 0], acceleration[0] * dt)
            vy = approach(vy, samples[k, 1], acceleration[1] * dt)
            vw = approach(vw, samples[k, 2], acceleration[2] * dt)
            if yaw != at:
                c, s, at = math.cos(yaw), math.sin(yaw), yaw
            if vy == 0.0:
                x += (vx * c) * dt
                y += (vx * s) * dt
            else:
                left = HALF_PI + yaw
                x += (vx * c + vy * math.cos(left)) * dt
                y += (vx * s + vy * math.sin(left)) * dt
            yaw += vw * dt


@kernel
def approach(value, target, change):
    """`value` changed towards `target` by at most `change`."""
    if value < target:
        return min(target, value + change)
    return max(target, value - change)


# pyright: basic


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
        per_meter = p.meter_scoring
        obstacle = UnscaledObstacleCritic(p.occdist_scale, per_meter and p.ros_distro == "indigo")
        path = PathDistanceCritic(p.path_distance_bias, per_meter)
        self._goal_distance = GoalDistanceCritic(p.goal_distance_bias, per_meter)
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
        ranges = generator.ranges(state, plan, limits)
        samples, turns = generator.speeds(ranges, limits, forward=not self._escape.active)
        first_turn, (_, _, right, left) = len(samples) - len(turns), ranges
        candidates = self._scored(context, samples)
        table = candidates.table

        best, nearest = lowest_legal(table.totals, table.rejected_by, first_turn), math.inf
        moved = self._flags.moved(state.pose, p.oscillation_reset_dist)
        circled = self._full_turn.complete(state.pose, moved=moved) and self.additions.full_turns
        if best < 0 or not circled:
            step = (left - right) / (len(turns) - 1) if len(turns) > 1 else math.inf
            best, nearest = self._turn_in_place(best, first_turn, turns, step, candidates)
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
        if best >= 0 and candidates.legal(best):
            self._escape.scale = 0.0  # the whole footprint is free
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
            points, self._escape.scale = free_backup_points(context, rollouts, p.escape_reset_dist, self._escape.scale)
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


# --- kernels --------------------------------------------------------------------------------------------------------


@kernel
def distances_ahead(grid, storage, poses, counts, first, ahead, out):
    """Write the grid's value `ahead` meters in front of the last point of each rollout from `first` on to `out`; -1 off the map.

    `grid`, `storage`: see `start_wavefront`.
    """
    nx, ny = grid[0].nx, grid[0].ny
    width = nx + 2
    end = STATE_SIZE + (ny + 2) * width + 1
    state, distances, queue = storage[:STATE_SIZE], storage[STATE_SIZE:end], storage[end:]
    for k in range(first, len(counts)):
        last = counts[k] - 1
        yaw = poses[k, last, 2]
        fx = (poses[k, last, 0] + ahead * math.cos(yaw) - grid[0].origin_x) / grid[0].resolution
        fy = (poses[k, last, 1] + ahead * math.sin(yaw) - grid[0].origin_y) / grid[0].resolution
        out[k - first] = -1.0
        if fx >= 0.0 and fy >= 0.0 and fx < nx and fy < ny:
            cell = (int(fy) + 1) * width + int(fx) + 1
            out[k - first] = grid_value(distances, queue, state, cell, width, nx * ny)


@plain_kernel
def lowest_legal(totals, rejected_by, number):
    """Return the index of the lowest total among the first `number` samples that are legal, -1 if none is."""
    best = -1
    for k in range(number):
        if rejected_by[k] == -1 and (best < 0 or totals[k] < totals[best]):
            best = k
    return best


@kernel
def sum_in_order(costs, scales, order, rejected_by, totals):
    """Write the totals of the legal rows, added up in the order of the columns `order`: C++'s rounding decides between equals."""
    for k in range(len(totals)):
        if rejected_by[k] == -1:
            total = 0.0
            for column in order:
                if scales[column] != 0.0:
                    total += costs[k, column] * scales[column]
            totals[k] = total
