"""Trajectory rollout of ROS 1: base_local_planner/TrajectoryPlannerROS, move_base's default local planner.

B. P. Gerkey, K. Konolige, "Planning and Control in Unstructured Terrain", 2008; as in base_local_planner/src/
trajectory_planner.cpp and trajectory_planner_ros.cpp. Simulates samples that accelerate toward their velocity: forward with
a turn, in place, sideways, and as a last resort backward. The robot that turns in place turns on: left/right flags hold
until it has moved.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import field_validator

from navstack.core import Costmap, Footprint, Pose2D, RobotState, Twist2D, angle_between
from navstack.core.errors import ControlError
from navstack.core.parameters import ParamModel, param
from navstack.interfaces import ControlInput, Critic, LocalPlan, Rollouts, ScoringContext, VelocityLimits
from navstack.local_planner._outline_kernels import perimeter_cost
from navstack.local_planner._toward_kernels import free_outline, heading_differences, simulate_toward
from navstack.local_planner.cells import RolloutCells
from navstack.local_planner.critics._grid_critic import CENTRE_CODES, GridCritic
from navstack.local_planner.critics._scale import RosDistro
from navstack.local_planner.critics.goal import GoalCritic, GoalParams
from navstack.local_planner.critics.obstacle import ObstacleCritic, ObstacleParams
from navstack.local_planner.goal_checker import GoalChecker
from navstack.local_planner.map_grid import MapGrid
from navstack.local_planner.plan_follower import PlanFollower
from navstack.local_planner.rollouts import check_points
from navstack.local_planner.scoring import ScoreTable, score
from navstack.plugins import LOCAL_PLANNERS

STOPPED = 1e-2
"""Slower than this (m/s, rad/s) counts as stopped: a constant in C++."""
STRAFE = 0.1
"""Speed (m/s) forward and to either side of the two strafing samples of a holonomic robot."""
OUTLINES = tuple(round(1.0 - 0.05 * i, 2) for i in range(6))
"""How much of the outline must be free where the robot stands for it to back out: padding is no more than the rest."""
HEADING_SCALE = 0.3
"""Weight of the heading difference with heading_scoring: a constant in C++."""


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
        "world_model": 'ROS knows only "costmap"',
        "point_grid": "read by a world model that ROS no longer has",
        "restore_defaults": "a button of dynamic_reconfigure",
        "publish_cost_grid_pc": "navstack publishes no topics; every command carries its table of samples",
        "global_frame_id": "it only names the frame of the published grid",
        "max_vel_y": "sideways speeds are those of y_vels",
        "min_vel_y": "sideways speeds are those of y_vels",
    }
    SEARCHED: ClassVar[frozenset[str]] = frozenset({"controller_frequency"})
    FROM_NAVSTACK: ClassVar[frozenset[str]] = frozenset({"ros_distro"})

    acc_lim_x: float = param(2.5, "acceleration along x", unit="m/s²", ge=0.0, le=20.0)
    acc_lim_y: float = param(2.5, "acceleration along y", unit="m/s²", ge=0.0, le=20.0)
    acc_lim_theta: float = param(3.2, "turning acceleration", unit="rad/s²", ge=0.0, le=20.0)
    max_vel_x: float = param(0.55, "highest forward speed", unit="m/s", ge=0.0, le=20.0)
    min_vel_x: float = param(0.0, "lowest forward speed", unit="m/s", ge=0.0, le=20.0)
    max_vel_theta: float = param(1.0, "highest turning speed, to the left", unit="rad/s", ge=0.0, le=20.0)
    min_vel_theta: float = param(-1.0, "highest turning speed to the right, negative", unit="rad/s", ge=-20.0, le=0.0)
    max_rotational_vel: float = param(1.0, "highest speed of the turn at the goal", unit="rad/s", ge=0.0)
    min_in_place_vel_theta: float = param(0.4, "lowest speed of a turn in place", unit="rad/s", ge=0.0, le=20.0)
    sim_time: float = param(1.7, "how far ahead trajectories are simulated", unit="s", gt=0.0, le=10.0)
    sim_granularity: float = param(0.025, "distance between the points of a trajectory", unit="m", gt=0.0, le=5.0)
    angular_sim_granularity: float = param(
        0.025, "turn between the points of a trajectory", unit="rad", gt=0.0, le=math.pi / 2
    )
    vx_samples: int = param(20, "forward speeds", ge=1, le=300)
    vtheta_samples: int = param(20, "turning speeds", ge=1, le=300)
    path_distance_bias: float = param(0.6, "weight of the distance to the plan", ge=0.0, le=5.0)
    goal_distance_bias: float = param(0.8, "weight of the distance to the local goal", ge=0.0, le=5.0)
    occdist_scale: float = param(0.01, "weight of the obstacle cost", ge=0.0, le=5.0)
    meter_scoring: bool = param(
        False,
        "distances count in metres instead of cells",
        ros_differs="unset, it is a bool that was never initialised; here it is false",
    )
    heading_lookahead: float = param(
        0.325, "how far ahead of the robot turns in place are compared", unit="m", ge=0.0, le=5.0
    )
    oscillation_reset_dist: float = param(0.05, "motion that allows turning the other way", unit="m", ge=0.0, le=5.0)
    escape_reset_dist: float = param(
        0.1,
        "motion that ends an escape",
        unit="m",
        ge=0.0,
        le=5.0,
        ros_differs="there every escape ends here, often for ever between two poses; here each from the same place goes back "
        "twice as far as the one before, and only where it comes no nearer to anything",
    )
    escape_reset_theta: float = param(math.pi / 2, "turn that ends an escape", unit="rad", ge=0.0, le=5.0)
    escape_vel: float = param(-0.1, "speed of backing out, negative", unit="m/s", ge=-2.0, le=2.0)
    holonomic_robot: bool = param(True, "sample sideways motion")
    y_vels: str | list[float] = param(
        "-0.3,-0.1,0.1,-0.3", "sideways speeds of a holonomic robot: a list, or one in a string", unit="m/s"
    )
    dwa: bool = param(False, "sample what can be reached within one period; otherwise within sim_time")
    heading_scoring: bool = param(False, "score the heading toward the plan, and distances after a moment only")
    heading_scoring_timestep: float = param(
        0.1, "when, along the trajectory, with heading_scoring", unit="s", ge=0.0, le=1.0
    )
    simple_attractor: bool = param(False, "squared distance to the plan's end in sight instead of the grids")
    prune_plan: bool = param(True, "drop the poses of the plan that the robot has passed (more than 1 m away)")
    yaw_goal_tolerance: float = param(0.05, "angle at which the goal's heading is reached", unit="rad", ge=0.0)
    xy_goal_tolerance: float = param(0.1, "distance at which the goal's position is reached", unit="m", ge=0.0)
    latch_xy_goal_tolerance: bool = param(
        False,
        "once at the goal's position, only turn",
        ros_differs="forgotten with every replan",
    )
    controller_frequency: float = param(20.0, "control cycles per second; 0 counts as 20", unit="Hz", ge=0.0)
    ros_distro: RosDistro = param(
        "noetic",
        "scoring scale of noetic, or of the releases before 2018, which with meter_scoring scaled obstacles too",
    )

    @field_validator("y_vels")
    @classmethod
    def _speeds(cls, value: str | list[float]) -> str | list[float]:
        y_speeds(value)
        return value


def y_speeds(value: str | Sequence[float]) -> list[float]:
    """The speeds of `y_vels`: "-0.3,0.3" or [-0.3, 0.3]."""
    try:
        speeds = [float(v) for v in (value.split(",") if isinstance(value, str) else value) if str(v).strip()]
    except ValueError as exc:
        raise ValueError(f"must be numbers separated by commas, not {value!r}") from exc
    if not all(math.isfinite(v) for v in speeds):
        raise ValueError("must be finite numbers")
    return speeds


class _RolloutPath(GridCritic):
    """Distance to the plan; the cells under the robot count as free."""

    CODES: ClassVar[dict[int, str]] = CENTRE_CODES

    def __init__(self, bias: float, per_metre: bool) -> None:
        super().__init__("path", None)
        self._bias = bias
        self._per_metre = per_metre
        self._scratch = np.empty((2, 0), np.int64)

    def weight(self, context: ScoringContext) -> float:
        return self._bias * (context.costmap.geometry.resolution if self._per_metre else 1.0)

    def build(self, context: ScoringContext) -> MapGrid:
        costmap = context.costmap.copy()
        g = costmap.geometry
        if self._scratch.shape[1] != g.nx:
            self._scratch = np.empty((2, g.nx), np.int64)
        free_outline(
            costmap.data,
            g.origin_x,
            g.origin_y,
            g.resolution,
            context.footprint.vertices,
            np.array(context.state.pose),
            self._scratch[0],
            self._scratch[1],
        )
        return self._buffer.build(costmap, context.plan, last_only=False)


class _RolloutGoal(GoalCritic):
    """Distance to the local goal."""

    def __init__(self, bias: float, per_metre: bool) -> None:
        super().__init__("goal", GoalParams())
        self._bias = bias
        self._per_metre = per_metre

    def weight(self, context: ScoringContext) -> float:
        return self._bias * (context.costmap.geometry.resolution if self._per_metre else 1.0)


class _Attractor(Critic):
    """Squared distance (m²) from the last point to the end of the plan in sight."""

    def __init__(self, weight: float) -> None:
        super().__init__("goal", None)
        self._weight = weight
        self._end = np.zeros(2)

    @property
    def scale(self) -> float:
        return self._weight

    def prepare(self, context: ScoringContext) -> None:
        self._end = context.plan[-1, :2]

    def score(self, rollouts: Rollouts, alive: NDArray[np.bool_]) -> NDArray[np.float64]:
        last = rollouts.poses[np.arange(len(alive)), np.maximum(rollouts.counts - 1, 0), :2]
        return np.where(alive, ((last - self._end) ** 2).sum(axis=1), 0.0)


class _RolloutObstacle(ObstacleCritic):
    """The highest cost under the outline, which does not grow here."""

    def __init__(self, weight: float, per_metre: bool) -> None:
        super().__init__("obstacle", ObstacleParams(occdist_scale=weight, scaling_speed=1e9))
        self._per_metre = per_metre

    @property
    def scale(self) -> float:
        return self._scale

    def prepare(self, context: ScoringContext) -> None:
        super().prepare(context)
        if self._per_metre:
            self._scale = self.params.occdist_scale * context.costmap.geometry.resolution


class _Heading(Critic):
    """The turn (rad) to the farthest pose of the plan in free sight."""

    def __init__(self) -> None:
        super().__init__("heading", None)
        self._context: ScoringContext | None = None

    @property
    def scale(self) -> float:
        return HEADING_SCALE

    def prepare(self, context: ScoringContext) -> None:
        self._context = context

    def score(self, rollouts: Rollouts, alive: NDArray[np.bool_]) -> NDArray[np.float64]:
        assert self._context is not None
        costmap = self._context.costmap
        g = costmap.geometry
        out = np.zeros(len(alive))
        if rollouts.poses.shape[1]:
            at = np.ascontiguousarray(rollouts.poses[:, 0])
            heading_differences(costmap.data, g.origin_x, g.origin_y, g.resolution, self._context.plan, at, alive, out)
            # C++ adds the largest double there is
            out[np.isinf(out)] = 1e300
        return out


class _AtMoment(Critic):
    """Another critic, shown only the point at which heading_scoring looks."""

    def __init__(self, inner: Critic, planner: TrajectoryPlanner) -> None:
        super().__init__(inner.name, inner.params)
        self._inner = inner
        self._planner = planner

    @property
    def scale(self) -> float:
        return self._inner.scale

    def prepare(self, context: ScoringContext) -> None:
        self._inner.prepare(context)

    def score(self, rollouts: Rollouts, alive: NDArray[np.bool_]) -> NDArray[np.float64]:
        point = self._planner.moment(int(rollouts.counts.max(initial=0)))
        if point is None:
            return np.zeros(len(alive))
        return self._inner.score(_one_point(rollouts, point), alive)


def _one_point(rollouts: Rollouts, point: int | NDArray[np.int64]) -> Rollouts:
    """The same rollouts reduced to one point each."""
    rows = np.arange(len(rollouts.counts))
    poses = np.ascontiguousarray(rollouts.poses[rows, point][:, None, :])
    return Rollouts(rollouts.samples, poses, np.minimum(rollouts.counts, 1))


@LOCAL_PLANNERS.register("trajectory_rollout", aliases=("base_local_planner/TrajectoryPlannerROS",))
class TrajectoryPlanner(PlanFollower):
    """Follows a plan by trajectory rollout; stops and turns at the goal.

    Stateful between cycles: the plan, whether the goal has been reached, the turning and strafing flags, the escape.
    """

    Params: ClassVar[type[ParamModel]] = TrajectoryPlannerParams
    params: TrajectoryPlannerParams

    def __init__(self, params: TrajectoryPlannerParams) -> None:
        p = params
        per_metre = p.meter_scoring
        obstacle = _RolloutObstacle(p.occdist_scale, per_metre and p.ros_distro == "indigo")
        self._path = _RolloutPath(p.path_distance_bias, per_metre)
        self._goal_critic = _RolloutGoal(p.goal_distance_bias, per_metre)
        critics: list[Critic] = [obstacle]
        if p.simple_attractor:
            critics.append(_Attractor(p.goal_distance_bias))
        elif p.heading_scoring:
            critics += [_AtMoment(c, self) for c in (self._path, self._goal_critic, _Heading())]
        else:
            critics += [self._path, self._goal_critic]
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
        self._limits = self._limits_of(None, None)
        self._reached = False
        self._turned = [False, False]  # left, right: chosen since the robot last moved
        self._only: list[bool] = [False, False]  # .. and chosen again: the other way is not open any more
        self._strafed = [False, False]
        self._strafe_only = [False, False]
        self._since = (0.0, 0.0)
        self._escape: Pose2D | None = None
        self._escape_dist = params.escape_reset_dist
        self._escaped: Pose2D | None = None  # where the last escape began
        self._turning: tuple[Pose2D, float] | None = None  # pose of the last cycle, angle turned in place up to then
        self._weary: Pose2D | None = None  # where a whole circle led nowhere

    # --- limits -----------------------------------------------------------------------------------------------------

    def _limits_of(self, max_vel_trans: float | None, max_vel_theta: float | None) -> VelocityLimits:
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

    @property
    def limits(self) -> VelocityLimits:
        """The limits in force."""
        return self._limits

    def set_limits(self, *, max_vel_trans: float | None = None, max_vel_theta: float | None = None) -> None:
        """Lowers the speed limits (m/s, rad/s) until called again; None restores that of the parameters."""
        for name, value in (("max_vel_trans", max_vel_trans), ("max_vel_theta", max_vel_theta)):
            if value is not None and not (math.isfinite(value) and value >= 0.0):
                raise ControlError(f"{name} must be a speed of at least 0, not {value}", limit=name, value=value)
        self._limits = self._limits_of(max_vel_trans, max_vel_theta)

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
            self._turning = self._weary = self._escaped = None

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
        closed = [way for way, other in (("left", self._only[1]), ("right", self._only[0])) if other]
        until = f"; turning {' or '.join(closed)} is closed until it has moved" if closed else ""
        return (
            "of the turns in place that cost no more than the best sample ahead, the one that looks nearest to the goal "
            f"wins{until}"
        )

    # --- samples ----------------------------------------------------------------------------------------------------

    def moment(self, steps: int) -> int | None:
        """Index of the point at heading_scoring_timestep, of trajectories of `steps` points; None beyond their end."""
        if steps == 0:
            return None
        point = math.ceil(self.params.heading_scoring_timestep / (self.params.sim_time / steps) - 1e-9)
        return point if point < steps else None

    def _ranges(self, state: RobotState, plan: NDArray[np.float64]) -> tuple[float, float, float, float]:
        """Lowest and highest vx, lowest and highest wz."""
        limits, p = self._limits, self.params
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

    def _rollouts(self, samples: NDArray[np.float64], state: RobotState) -> Rollouts:
        p, limits = self.params, self._limits
        if p.heading_scoring:
            counts = np.full(len(samples), int(p.sim_time / p.sim_granularity + 0.5), np.int64)
        else:
            steps = np.maximum(
                np.hypot(samples[:, 0], samples[:, 1]) * (p.sim_time / p.sim_granularity),
                np.abs(samples[:, 2]) / p.angular_sim_granularity,
            )
            counts = (steps + 0.5).astype(np.int64)
        counts = np.maximum(counts, 1)
        longest = int(counts.max())
        check_points(len(samples), longest)
        poses = np.empty((len(samples), longest, 3))
        simulate_toward(
            samples,
            np.array(state.pose),
            np.array(state.velocity),
            np.array((limits.acc_lim_x, limits.acc_lim_y, limits.acc_lim_theta)),
            p.sim_time,
            counts,
            poses,
        )
        return Rollouts(samples, poses, counts)

    def simulated(self, command: Twist2D, state: RobotState) -> Rollouts:
        """The one trajectory of a command at the goal."""
        return self._rollouts(np.array([command]), state)

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
        p, limits = self.params, self._limits
        context = self.context(state, costmap, footprint, plan, goal)

        bottom, top, right, left = self._ranges(state, plan)
        nx, nw = p.vx_samples, p.vtheta_samples
        dw = (left - right) / (nw - 1) if nw > 1 else math.inf
        turns: NDArray[np.float64] = np.linspace(right, left, nw) if nw > 1 else np.array([right])
        forward = np.empty((0, 3))
        if self._escape is None:
            speeds = np.linspace(bottom, top, nx)
            # each speed straight on, then with every turn but the last
            forward = np.zeros((nx, nw, 3))
            forward[:, :, 0] = speeds[:, None]
            forward[:, 1:, 2] = turns[:-1]
            forward = forward.reshape(-1, 3)
            strafe = min(STRAFE, limits.max_vel_x)
            if p.holonomic_robot and math.hypot(strafe, STRAFE) <= limits.max_vel_trans:
                forward = np.vstack((forward, [(strafe, STRAFE, 0.0), (strafe, -STRAFE, 0.0)]))
        in_place = np.zeros((nw, 3))
        slowest = limits.min_vel_theta
        in_place[:, 2] = np.where(turns > 0.0, np.maximum(turns, slowest), np.minimum(turns, -slowest))
        samples = np.vstack((forward, in_place))
        rollouts = self._rollouts(samples, state)
        table = score(self.critics, context, rollouts)

        totals, legal = table.totals, table.rejected_by == -1
        best = -1
        if len(forward) and legal[: len(forward)].any():
            best = int(np.where(legal[: len(forward)], totals[: len(forward)], np.inf).argmin())
        nearest = math.inf
        if best < 0 or not self._has_circled(state.pose):
            best, nearest = self._turn_in_place(best, nearest, len(forward), turns, dw, table, rollouts, legal)
        mode = "follow"
        if best < 0 and p.holonomic_robot and self._y_vels:
            first = len(samples)
            sideways = np.zeros((len(self._y_vels), 3))
            sideways[:, 1] = np.clip(self._y_vels, limits.min_vel_y, limits.max_vel_y)
            samples, rollouts, table = self._more(context, samples, sideways)
            best = self._strafe(first, nearest, table, rollouts)
        if best >= 0:
            self._note_direction(samples[best], state.pose)
        elif p.escape_vel != 0.0:
            escape = np.array([(max(p.escape_vel, limits.min_vel_x), 0.0, 0.0)])
            samples, rollouts, table = self._more(context, samples, escape)
            points = len(rollouts.poses[-1]) if table.rejected_by[-1] == -1 else self._way_out(context, rollouts)
            if points:
                best = len(samples) - 1
                mode = "escape"
                rollouts.counts[-1] = min(rollouts.counts[-1], points)  # what was checked
                self._begin_escape(state.pose)
            else:
                self._escape = None  # no farther: the next cycle tries everything again
        self._forget(state.pose)
        command = Twist2D(*samples[best].tolist()) if best >= 0 else Twist2D()
        chosen = ScoreTable(table.costs, table.scales, table.totals, table.rejected_by, best)
        return self.result(command, samples, chosen, rollouts, context, mode)

    def _way_out(self, context: ScoringContext, rollouts: Rollouts) -> int:
        """Points of the last trajectory, backing out, that come no nearer to anything than the robot already is; 0: it does.

        ROS differs: C++ backs up whatever is behind it. Here the outline may stand on lethal cells (it is padded, and cells
        are coarse), but, shrunk until it is free where it stands, it must stay free until the escape is over and braked, give
        or take half a cell.
        """
        p, g = self.params, context.costmap.geometry
        speed = abs(float(rollouts.samples[-1, 0]))
        braking = speed * speed / (2.0 * p.acc_lim_x) if p.acc_lim_x > 0.0 else 0.0
        way = rollouts.poses[-1, : rollouts.counts[-1]]
        along = np.hypot(way[:, 0] - way[0, 0], way[:, 1] - way[0, 1])
        way = way[along <= p.escape_reset_dist + braking + g.resolution].tolist()

        def is_free(pose: list[float], scale: float) -> bool:
            x, y, yaw = pose
            if g.world_to_cell(x, y) is None:
                return False
            vertices = context.footprint.vertices
            cost = perimeter_cost(
                context.costmap.data, g.origin_x, g.origin_y, g.resolution, vertices, x, y, yaw, scale
            )
            return bool(cost >= 0)

        scale = next((scale for scale in OUTLINES if is_free(way[0], scale)), None)
        if scale is None:
            return 0
        # what slides along the outline falls into one cell or the next
        scale -= 0.5 * g.resolution / max(context.footprint.inscribed_radius, g.resolution)
        return len(way) if all(is_free(pose, scale) for pose in way) else 0

    def _more(
        self, context: ScoringContext, samples: NDArray[np.float64], added: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], Rollouts, ScoreTable]:
        """The table again with further samples, tried only because nothing before was legal."""
        samples = np.vstack((samples, added))
        rollouts = self._rollouts(samples, context.state)
        return samples, rollouts, score(self.critics, context, rollouts)

    def _ahead(self, rollouts: Rollouts, rows: slice) -> NDArray[np.float64]:
        """Goal distance (cells) seen heading_lookahead ahead of each trajectory's end; negative off the map."""
        part = Rollouts(rollouts.samples[rows], rollouts.poses[rows], rollouts.counts[rows])
        ends = _one_point(part, part.counts - 1)
        grid = self._goal_critic.grid
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
            open_way = not self._only[0] if turn < 0.0 else not self._only[1]
            if 0.0 <= ahead[i] < nearest and open_way:
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
            open_way = not self._strafe_only[0] if rollouts.samples[k, 1] < 0.0 else not self._strafe_only[1]
            if 0.0 <= ahead[i] < nearest and open_way:
                best, nearest = k, float(ahead[i])
        return best

    # --- memory -----------------------------------------------------------------------------------------------------

    def _has_circled(self, pose: Pose2D) -> bool:
        """True from a whole circle in place on, until the robot has come as far as its samples look.

        ROS differs: where driving on costs more than it is worth, C++ turns in place for ever. All there is to see was seen
        in one circle: from then on the best sample ahead is taken.
        """
        if self._weary is not None and pose.distance_to(self._weary) > self.params.max_vel_x * self.params.sim_time:
            self._weary = None
        if self._turning is not None:
            before, turned = self._turning
            if pose.distance_to(Pose2D(*self._since)) > self.params.oscillation_reset_dist:
                self._turning = None
            else:
                turned += abs(angle_between(before.yaw, pose.yaw))
                self._turning = pose, turned
                if turned > 2.0 * math.pi:
                    self._turning, self._weary = None, pose
        return self._weary is not None

    def _note_direction(self, sample: NDArray[np.float64], pose: Pose2D) -> None:
        """A way chosen twice without moving is the only one until the robot has moved."""
        if sample[0] > 0.0:
            return
        if self._turning is None and sample[2] != 0.0:
            self._turning = pose, 0.0
        for value, chosen, only in (
            (sample[2], self._turned, self._only),
            (sample[1], self._strafed, self._strafe_only),
        ):
            if value != 0.0:
                side = 0 if value > 0.0 else 1
                only[side] = only[side] or chosen[side]
                chosen[side] = True
                break
        self._since = (pose.x, pose.y)

    def _begin_escape(self, pose: Pose2D) -> None:
        """Takes note of where an escape begins; from one place, each goes back twice as far as the one before.

        ROS differs: C++ always goes back escape_reset_dist, and often for ever between two poses that differ by that.
        """
        if self._escape is not None:
            return
        farthest = max(self.params.max_vel_x * self.params.sim_time, self.params.escape_reset_dist)
        if self._escaped is not None and pose.distance_to(self._escaped) <= farthest:
            self._escape_dist = min(2.0 * self._escape_dist, farthest)
        else:
            self._escape_dist = self.params.escape_reset_dist
        self._escape = self._escaped = pose

    def _forget(self, pose: Pose2D) -> None:
        p = self.params
        if math.hypot(pose.x - self._since[0], pose.y - self._since[1]) > p.oscillation_reset_dist:
            for flags in (self._turned, self._only, self._strafed, self._strafe_only):
                flags[:] = [False, False]
        if self._escape is not None and (
            pose.distance_to(self._escape) > self._escape_dist
            or abs(angle_between(self._escape.yaw, pose.yaw)) > p.escape_reset_theta
        ):
            self._escape = None
