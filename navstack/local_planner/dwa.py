# pyright: basic
"""The dynamic window approach of ROS 1: dwa_local_planner/DWAPlannerROS.

D. Fox, W. Burgard, S. Thrun, "The Dynamic Window Approach to Collision Avoidance", 1997; as in
dwa_local_planner/src/dwa_planner.cpp and dwa_planner_ros.cpp. Samples velocities that are reachable within one control
period, simulates each for `sim_time`, and selects the one with the lowest total of its critics. Its horizon is `sim_time`:
beyond it, it relies on the global plan.

The generator is that of SimpleTrajectoryGenerator (base_local_planner), with its rounding: C++ stores poses and velocities
as `Eigen::Vector3f`. Values stored between two steps are therefore rounded to float32 here,
too, while each step is computed in double precision: the samples, points and cells are the same.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from copy import copy
from typing import Any, ClassVar, Final, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from navstack.core import Costmap, Footprint, Pose2D, RobotState, Twist2D, plain_kernel
from navstack.local_planner import parameter_checks as checks
from navstack.local_planner.critics.alignment import AlignmentParams
from navstack.local_planner.critics.goal import GoalParams
from navstack.local_planner.critics.goal_front import GoalFrontParams
from navstack.local_planner.critics.obstacle import ObstacleCritic, ObstacleParams
from navstack.local_planner.critics.oscillation import OscillationParams
from navstack.local_planner.critics.path import PathParams
from navstack.local_planner.critics.twirling import TwirlingParams
from navstack.local_planner.goal_checkers import LatchingGoalChecker
from navstack.local_planner.map_grid import RosDistro
from navstack.local_planner.overlap import Overlap
from navstack.local_planner.rollouts import check_points, check_samples
from navstack.local_planner.sampling_planner import SamplingPlanner, control_period
from navstack.local_planner.scoring import ScoreTable, score
from navstack.plugins import (
    CRITICS,
    LOCAL_PLANNERS,
    CheckContext,
    Critic,
    Issue,
    LocalPlan,
    ParamModel,
    PluginSpec,
    Rollouts,
    ScoringContext,
    TrajectoryGenerator,
    VelocityLimits,
    param,
)

FEWEST = 4
"""Points of a rollout that is integrated by `integrate_forwards`: more."""
HALF_PI_HIGH, HALF_PI_LOW = 1.5707963267341256, 6.077100506506192e-11
"""pi / 2 in two parts: multiples of the first one are exact."""
HEADING_ERROR = 1e-14
EPS = 1e-4  # tolerance of the speed limits (SimpleTrajectoryGenerator::generateTrajectory)

DEFAULT_CRITICS: tuple[str, ...] = (
    "oscillation",
    "obstacle",
    "goal_front",
    "alignment",
    "path",
    "goal",
    "twirling",
)
"""The seven critics of move_base, in its order: the first that rejects a rollout gives the reason."""


def shared_param(critic: type[ParamModel], name: str) -> Any:
    """Return the declaration of a critic's parameter: in ROS the planner's namespace holds it, here the critic declares it."""
    return copy(critic.model_fields[name])


WEIGHTS_BEFORE_2018: Final = {"path_distance_bias": 32.0, "goal_distance_bias": 24.0}
"""Defaults of DWAPlanner.cfg before navigation 1.16.0 (2018-07-25), whose scores were scaled otherwise."""


class DWAParams(ParamModel):
    """Parameters of DWAPlannerROS (dwa_local_planner/cfg/DWAPlanner.cfg, base_local_planner's local_planner_limits)."""

    RENAMED: ClassVar[Mapping[str, str]] = {
        "max_trans_vel": "max_vel_trans",
        "min_trans_vel": "min_vel_trans",
        "max_rot_vel": "max_vel_theta",
        "min_rot_vel": "min_vel_theta",
        "rot_stopped_vel": "theta_stopped_vel",
        "vtheta_samples": "vth_samples",
        "acc_limit_x": "acc_lim_x",
        "acc_limit_y": "acc_lim_y",
        "acc_limit_th": "acc_lim_theta",
        "acc_lim_th": "acc_lim_theta",
        "pdist_scale": "path_distance_bias",
        "gdist_scale": "goal_distance_bias",
    }
    NO_EFFECT: ClassVar[Mapping[str, str]] = {
        "stop_time_buffer": "ROS stores it but never uses it",
        "acc_lim_trans": "ROS stores it but never uses it",
        "acc_limit_trans": "the old name of acc_lim_trans, which ROS stores but never uses",
        "restore_defaults": "a button of dynamic_reconfigure",
        "holonomic_robot": "a parameter of TrajectoryPlannerROS; DWA uses max_vel_y and min_vel_y",
        "penalize_negative_x": "removed in hydro; see the prefer_forward critic",
    }
    SEARCHED: ClassVar[frozenset[str]] = frozenset({"controller_frequency", "latch_xy_goal_tolerance"})
    FROM_NAVSTACK: ClassVar[frozenset[str]] = frozenset({"ros_distro"})
    CLAMPED: ClassVar[frozenset[str]] = frozenset(
        {
            "max_vel_trans",
            "min_vel_trans",
            "max_vel_theta",
            "min_vel_theta",
            "acc_lim_x",
            "acc_lim_y",
            "acc_lim_theta",
            "path_distance_bias",
            "goal_distance_bias",
            "occdist_scale",
            "twirling_scale",
            "oscillation_reset_dist",
            "oscillation_reset_angle",
            "scaling_speed",
            "max_scaling_factor",
            "vx_samples",
            "vy_samples",
            "vth_samples",
        }
    )
    CHILD_FIELD: ClassVar[str | None] = "critic_params"

    max_vel_trans: float = param(0.55, "highest translational speed", unit="m/s", ge=0.0)
    min_vel_trans: float = param(
        0.1, "lowest translational speed of samples that turn by less than min_vel_theta", unit="m/s", ge=0.0
    )
    max_vel_x: float = param(0.55, "highest forward speed", unit="m/s")
    min_vel_x: float = param(0.0, "lowest forward speed; negative allows driving backward", unit="m/s")
    max_vel_y: float = param(0.1, "highest speed to the left", unit="m/s")
    min_vel_y: float = param(-0.1, "lowest speed to the left; negative is to the right", unit="m/s")
    max_vel_theta: float = param(
        1.0,
        "highest turning speed in both directions",
        unit="rad/s",
        ge=0.0,
        ros_differs="above pi the command turns the wrong way there, because it is converted through a quaternion",
    )
    min_vel_theta: float = param(
        0.4, "lowest turning speed of samples that move by less than min_vel_trans", unit="rad/s", ge=0.0
    )
    acc_lim_x: float = param(2.5, "acceleration along x", unit="m/s²", ge=0.0, le=20.0)
    acc_lim_y: float = param(2.5, "acceleration along y", unit="m/s²", ge=0.0, le=20.0)
    acc_lim_theta: float = param(3.2, "turning acceleration", unit="rad/s²", ge=0.0, le=20.0)
    prune_plan: bool = param(False, "drop poses of the plan behind the robot, more than 1 m away")
    xy_goal_tolerance: float = param(0.1, "distance at which the goal's position is reached", unit="m", ge=0.0)
    yaw_goal_tolerance: float = param(0.1, "angle at which the goal's heading is reached", unit="rad", ge=0.0)
    trans_stopped_vel: float = param(
        0.1, "speed along x and y up to which the robot counts as stopped", unit="m/s", ge=0.0
    )
    theta_stopped_vel: float = param(0.1, "turning speed up to which the robot counts as stopped", unit="rad/s", ge=0.0)
    latch_xy_goal_tolerance: bool = param(
        False,
        "once at the goal's position, only turn, even if the robot leaves the tolerance",
        ros_differs="read from move_base's namespace only, and released by every replan",
    )
    sim_time: float = param(1.7, "duration of the simulated trajectories", unit="s", gt=0.0)
    sim_granularity: float = param(0.025, "distance between the points of a trajectory", unit="m", gt=0.0)
    angular_sim_granularity: float = param(0.1, "turn between the points of a trajectory", unit="rad", gt=0.0)
    path_distance_bias: float = shared_param(PathParams, "path_distance_bias")
    goal_distance_bias: float = shared_param(GoalParams, "goal_distance_bias")
    occdist_scale: float = shared_param(ObstacleParams, "occdist_scale")
    twirling_scale: float = shared_param(TwirlingParams, "twirling_scale")
    oscillation_reset_dist: float = shared_param(OscillationParams, "oscillation_reset_dist")
    oscillation_reset_angle: float = shared_param(OscillationParams, "oscillation_reset_angle")
    forward_point_distance: float = shared_param(GoalFrontParams, "forward_point_distance")
    cheat_factor: float = shared_param(AlignmentParams, "cheat_factor")
    scaling_speed: float = shared_param(ObstacleParams, "scaling_speed")
    max_scaling_factor: float = shared_param(ObstacleParams, "max_scaling_factor")
    vx_samples: int = param(3, "number of velocities along x (at least 2 are used)", ge=1)
    vy_samples: int = param(
        10, "number of velocities along y (at least 2 are used if the limits differ); 0 counts as 1, as in ROS", ge=0
    )
    vth_samples: int = param(20, "number of turning speeds (at least 2 are used)", ge=1)
    use_dwa: bool = param(True, "sample velocities reachable within one period; otherwise within sim_time")
    sum_scores: bool = shared_param(ObstacleParams, "sum_scores")
    controller_frequency: float = param(20.0, "control cycles per second; 0 counts as 20", unit="Hz", ge=0.0)
    ros_distro: RosDistro = param(
        "noetic",
        "scoring scale of noetic, or of the releases before 2018 (indigo), for which most published YAML was tuned; their "
        "defaults of path_distance_bias and goal_distance_bias were 32 and 24",
    )
    publish_traj_pc: bool = param(False, "publish the legal trajectories on trajectory_cloud (ROS 1 node)")
    publish_cost_grid_pc: bool = param(False, "publish the costs of the cells on cost_cloud (ROS 1 node)")
    global_frame_id: str = param("odom", "frame of trajectory_cloud (ROS 1 node)")
    odom_topic: str = param("odom", "topic of the odometry (ROS 1 node)")
    critics: list[PluginSpec] | None = param(
        None, "ordered critics instead of the seven of move_base: a list of {name, type}; an addition of navstack"
    )
    critic_params: dict[str, Any] = param({}, "parameters of listed critics, from the namespaces of their names")

    @model_validator(mode="before")
    @classmethod
    def _default_weights(cls, values: Any) -> Any:
        """The weights that are not set, for the scoring of before 2018: the defaults of that time."""
        if isinstance(values, Mapping) and values.get("ros_distro") == "indigo":
            return {**WEIGHTS_BEFORE_2018, **values}
        return values

    @model_validator(mode="after")
    def _check_samples(self) -> Self:
        check_samples({name: max(1, getattr(self, name)) for name in ("vx_samples", "vy_samples", "vth_samples")})
        return self

    @classmethod
    def child_models(cls, values: Mapping[str, Any]) -> dict[str, type[ParamModel]]:
        """Parameter models of the listed critics, by namespace."""
        listed = values.get("critics")
        found: dict[str, type[ParamModel]] = {}
        for entry in listed if isinstance(listed, list) else []:
            if not isinstance(entry, Mapping):
                continue
            name, kind = entry.get("name"), entry.get("type")
            if isinstance(name, str) and isinstance(kind, str) and kind in CRITICS:
                found[name] = CRITICS.get(kind).cls.Params
        return found

    def check(self, context: CheckContext) -> Iterator[Issue]:
        """Yield what keeps the robot from moving, from stopping or from reaching its goal."""
        yield from self._check_scoring_scale(context)
        fastest = self._fastest()
        yield from checks.window_too_small(context, self.sim_time, fastest, self.forward_point_distance)
        yield from checks.updates_too_slow(context, fastest)
        if self.use_dwa:
            yield from checks.cannot_start(
                context, self.acc_lim_x, self.acc_lim_theta, self.min_vel_trans, self.min_vel_theta
            )
            yield from checks.coarse_speeds(
                context,
                speeds=(self.min_vel_x, fastest.value),
                acceleration=self.acc_lim_x,
                samples=self.vx_samples,
                sim_time=self.sim_time,
                xy_goal_tolerance=self.xy_goal_tolerance,
            )
        yield from checks.stopping_time(context, checks.Limit("acc_lim_x", self.acc_lim_x), fastest, self.sim_time)
        yield from checks.coarse_simulation(context, self.sim_granularity, self.sim_time, self.acc_lim_x, fastest)
        yield from checks.minimum_over_maximum(
            [
                ("min_vel_x", self.min_vel_x, "max_vel_x", self.max_vel_x),
                ("min_vel_y", self.min_vel_y, "max_vel_y", self.max_vel_y),
                ("min_vel_trans", self.min_vel_trans, "max_vel_trans", self.max_vel_trans),
                ("min_vel_theta", self.min_vel_theta, "max_vel_theta", self.max_vel_theta),
            ]
        )
        yield from checks.vy_samples_zero(self.vy_samples)
        yield from checks.min_vel_trans_zero(self.min_vel_trans, self.min_vel_theta)
        yield from checks.goal_tolerances(context, self.xy_goal_tolerance, self.yaw_goal_tolerance, self.min_vel_theta)

    def _fastest(self) -> checks.Limit:
        """Return the highest forward speed: a sample above max_vel_trans is rejected, whatever max_vel_x allows."""
        return min(
            checks.Limit("max_vel_x", self.max_vel_x),
            checks.Limit("max_vel_trans", self.max_vel_trans),
            key=lambda speed: speed.value,
        )

    def _check_scoring_scale(self, context: CheckContext) -> Iterator[Issue]:
        resolution = context.local_costmap.resolution
        obstacle = self.occdist_scale * checks.INSCRIBED_COST
        # the goal and goal_front critics both fall by a meter's worth
        noetic, indigo = (2.0 * self.goal_distance_bias, obstacle), (self.goal_distance_bias, obstacle * resolution)
        return checks.scoring_scale(
            context,
            horizon=self.sim_time * self._fastest().value,
            goal_distance_bias=self.goal_distance_bias,
            occdist_scale=self.occdist_scale,
            score=indigo if context.ros_distro == "indigo" else noetic,
            indigo_score=indigo,
            factor=1.0 / (2.0 * resolution),
        )


def make_critics(params: DWAParams) -> list[Critic]:
    """The critics of a planner.

    A critic's parameters come from its own namespace, then from those of the planner's parameters of the same name that were
    set, then from its defaults.
    """
    wanted = (
        [(entry.name, entry.type) for entry in params.critics]
        if params.critics is not None
        else [(name, name) for name in DEFAULT_CRITICS]
    )
    made: list[Critic] = []
    for name, kind in wanted:
        cls = CRITICS.get(kind).cls
        values: dict[str, Any] = {
            n: getattr(params, n) for n in cls.Params.model_fields if n in params.model_fields_set
        }
        # a critic may call a parameter otherwise than ROS does
        former = {new: old for old, new in cls.Params.RENAMED.items() if old in params.model_fields_set}
        values.update({new: getattr(params, old) for new, old in former.items()})
        own = params.critic_params.get(name)
        if own is not None:
            values.update({n: getattr(own, n) for n in own.model_fields_set if n != "ros_distro"})
        made.append(cls(name, cls.Params(**values)))
    return made


@LOCAL_PLANNERS.register("dwa", aliases=("dwa_local_planner/DWAPlannerROS",))
class DWAPlanner(SamplingPlanner):
    """Follows a plan by the dynamic window approach; stops and turns at the goal.

    State between cycles: the plan, the goal checker, the phase at the goal, the state of the critics.
    """

    Params: ClassVar[type[ParamModel]] = DWAParams
    params: DWAParams
    leaves_obstacles = True
    """ROS differs: if every sample is rejected, leave the lethal cells under the footprint (`Overlap`)."""

    def __init__(self, params: DWAParams) -> None:
        p = params
        critics = make_critics(p)
        # commands at the goal are checked for collisions even if the list of critics has no obstacle critic
        obstacle = next((c for c in critics if isinstance(c, ObstacleCritic)), None) or ObstacleCritic(
            "obstacle", ObstacleParams(scaling_speed=p.scaling_speed, max_scaling_factor=p.max_scaling_factor)
        )
        checker = LatchingGoalChecker(
            p.xy_goal_tolerance,
            p.yaw_goal_tolerance,
            p.trans_stopped_vel,
            p.theta_stopped_vel,
            latch=p.latch_xy_goal_tolerance,
        )
        self.generator: DWAGenerator
        super().__init__(p, critics, obstacle, checker, DWAGenerator(p, control_period(p.controller_frequency)))

    def lowered_limits(self, max_vel_trans: float | None, max_vel_theta: float | None) -> VelocityLimits:
        """The limits of the parameters, lowered to these speeds.

        A lowered limit caps each axis, too: a robot that is faster gets the limit itself instead of no legal sample.
        """
        p = self.params
        trans = p.max_vel_trans if max_vel_trans is None else min(p.max_vel_trans, max_vel_trans)
        theta = p.max_vel_theta if max_vel_theta is None else min(p.max_vel_theta, max_vel_theta)
        along = p.max_vel_x if max_vel_trans is None else min(p.max_vel_x, trans)
        return VelocityLimits(
            max_vel_x=along,
            min_vel_x=min(p.min_vel_x, along) if max_vel_trans is not None else p.min_vel_x,
            max_vel_y=p.max_vel_y,
            min_vel_y=p.min_vel_y,
            max_vel_trans=trans,
            min_vel_trans=p.min_vel_trans if max_vel_trans is None else min(p.min_vel_trans, trans),
            max_vel_theta=theta,
            min_vel_theta=p.min_vel_theta if max_vel_theta is None else min(p.min_vel_theta, theta),
            # LocalPlannerLimits::getAccLimits returns a Vector3f
            acc_lim_x=float(np.float32(p.acc_lim_x)),
            acc_lim_y=float(np.float32(p.acc_lim_y)),
            acc_lim_theta=float(np.float32(p.acc_lim_theta)),
            yaw_goal_tolerance=p.yaw_goal_tolerance,
        )

    def search(
        self,
        state: RobotState,
        costmap: Costmap,
        footprint: Footprint,
        plan: NDArray[np.float64],
        goal: Pose2D,
    ) -> LocalPlan:
        """Select the best sample for following `plan` (n, 3), all in the costmap's frame (DWAPlanner::findBestPath)."""
        context = self.context(state, costmap, footprint, plan, goal)
        window = self.generator.window(state, plan, self._limits)
        samples, rollouts, table = self._scored(window, context)
        if table.best < 0 and self.generator.widen_rotation(window, state, self._limits):
            context = self.context(state, costmap, footprint, plan, goal)
            samples, rollouts, table = self._scored(window, context)
        overlap = None
        if table.best < 0 and self.leaves_obstacles and self._collision_check in self.critics:
            overlap = Overlap.at(context)
        if overlap is not None:
            samples, rollouts, table = self._scored(window, overlap.relaxed())
            table = self._without_nearer(overlap, rollouts, table)
        command = Twist2D(*rollouts.commands[table.best].tolist()) if table.best >= 0 else Twist2D()
        mode = "follow" if overlap is None or table.best < 0 else "escape"
        return self.result(command, samples.copy(), table, rollouts, context, mode)

    def _without_nearer(self, overlap: Overlap, rollouts: Rollouts, table: ScoreTable) -> ScoreTable:
        """`table`, scored with `overlap.relaxed()`, without the rollouts that come nearer to the overlapped cells."""
        check = self._collision_check
        table = overlap.select(rollouts, table, self.critics.index(check), check.first_collision)
        check.set_result(overlap.context, rollouts, check.scale, check.first_collision)
        if table.best >= 0:
            overlap.context.notes.append(overlap.note)
        return table

    def _scored(
        self, window: NDArray[np.float64], context: ScoringContext
    ) -> tuple[NDArray[np.float64], Rollouts, ScoreTable]:
        samples = self.generator.lattice(window)
        rollouts = self.generator.simulate(samples, context.state, self._limits)
        return samples, rollouts, score(self.critics, context, rollouts)


# --- the trajectory generator ----------------------------------------------------------------------------------------

SIMULATION_SETTINGS = np.dtype(
    [
        ("acc_lim_x", "f8"),
        ("acc_lim_y", "f8"),
        ("acc_lim_theta", "f8"),
        ("min_vel_trans", "f8"),
        ("max_vel_trans", "f8"),
        ("min_vel_theta", "f8"),
        ("sim_time", "f8"),
        ("sim_granularity", "f8"),
        ("angular_sim_granularity", "f8"),
        ("accelerate", "?"),
    ]
)
"""Settings of the simulation, named as the parameters. `accelerate`: the velocity approaches the sample (use_dwa is off)."""


class DWAGenerator(TrajectoryGenerator):
    """Samples velocities that are reachable within one period and simulates each for sim_time.

    Its arrays are buffers: samples and rollouts are valid until the next call.
    """

    def __init__(self, params: DWAParams, period: float) -> None:
        """`period`: the control period (s)."""
        self._params = params
        self._period = period
        numbers = (params.vx_samples, params.vy_samples, params.vth_samples)
        widest = [max(2, n) + 1 for n in numbers]
        capacity = widest[0] * widest[1] * widest[2]
        self._numbers = numbers
        self._axis_values = np.empty((3, max(widest)))
        self._samples = np.empty((capacity, 3))
        self._commands = np.empty((capacity, 3))
        self._counts = np.empty(capacity, np.int64)
        self._points = np.empty(0)
        self._scratch = np.empty(3 * 64)
        self._limits: VelocityLimits | None = None
        self._settings = np.empty(1, SIMULATION_SETTINGS)

    # --- velocity samples -------------------------------------------------------------------------------------------

    def samples(self, state: RobotState, plan: NDArray[np.float64], limits: VelocityLimits) -> NDArray[np.float64]:
        """(K, 3) velocities of the window, in C++'s order."""
        return self.lattice(self.window(state, plan, limits))

    def window(self, state: RobotState, plan: NDArray[np.float64], limits: VelocityLimits) -> NDArray[np.float64]:
        """(3, 2) lowest and highest vx, vy, wz to sample."""
        p = self._params
        if not p.use_dwa:
            # without the dynamic window: at most the speed that reaches the end of the local plan (float32 as in C++)
            offset = plan[-1, :2].astype(np.float32) - np.array(state.pose[:2], np.float32)
            distance = math.hypot(float(offset[0]), float(offset[1]))
            capped = limits._replace(
                max_vel_x=max(min(limits.max_vel_x, distance / p.sim_time), limits.min_vel_x),
                max_vel_y=max(min(limits.max_vel_y, distance / p.sim_time), limits.min_vel_y),
            )
            return velocity_window(state.velocity, capped, p.sim_time)
        window = velocity_window(state.velocity, limits, self._period)
        # ROS differs: if one period's acceleration stays below min_vel_trans, C++ cannot start to move: only turns in place
        # are legal, forever. Here the lowest speed can be commanded from rest, as a turn at the goal can.
        lowest = limits.min_vel_trans
        if limits.acc_lim_x * self._period < lowest and state.velocity.speed < lowest:
            window[0, 0] = max(limits.min_vel_x, min(window[0, 0], -lowest))
            window[0, 1] = min(limits.max_vel_x, max(window[0, 1], lowest))
        return window

    def widen_rotation(self, window: NDArray[np.float64], state: RobotState, limits: VelocityLimits) -> bool:
        """Widen `window` to min_vel_theta in both directions if acceleration alone does not reach it; False if it does."""
        lowest = min(limits.min_vel_theta, limits.max_vel_theta)
        if not self._params.use_dwa or abs(state.velocity.wz) + limits.acc_lim_theta * self._period >= lowest:
            return False
        # ROS differs: if acc_lim_theta / controller_frequency is below min_vel_theta, a robot that cannot drive is stuck
        window[2] = -lowest, lowest
        return True

    def lattice(self, window: NDArray[np.float64]) -> NDArray[np.float64]:
        """(K, 3) velocities of the window, in C++'s order."""
        count = sample_velocities(window, *self._numbers, self._axis_values, self._samples)
        return self._samples[:count]

    # --- rollouts ---------------------------------------------------------------------------------------------------

    def simulate(self, samples: NDArray[np.float64], state: RobotState, limits: VelocityLimits) -> Rollouts:
        """Rollouts of `samples` (K, 3); samples below both lowest speeds or above the highest speed have no points."""
        k = len(samples)
        if k > len(self._counts):
            self._commands = np.empty((k, 3))
            self._counts = np.empty(k, np.int64)
        if limits is not self._limits:
            self._set_limits(limits)
        longest = self._run(samples, state)
        if k * longest * 3 > len(self._points) or 3 * longest > len(self._scratch):
            check_points(k, longest)
            self._points, self._scratch = np.empty(k * longest * 3), np.empty(3 * longest)
            self._run(samples, state)
        poses = self._points[: k * longest * 3].reshape(k, longest, 3)
        return Rollouts(self._commands[:k], poses, self._counts[:k])

    def _run(self, samples: NDArray[np.float64], state: RobotState) -> int:
        k = len(samples)
        (x, y, yaw), (vx, vy, wz) = state.pose, state.velocity
        return simulate(
            samples,
            float(x),  # integers would compile another version of the kernel
            float(y),
            float(yaw),
            float(vx),
            float(vy),
            float(wz),
            self._settings,
            self._counts[:k],
            self._commands[:k],
            self._points,
            self._scratch,
        )

    def _set_limits(self, limits: VelocityLimits) -> None:
        p = self._params
        self._limits = limits
        self._settings[0] = (
            limits.acc_lim_x,
            limits.acc_lim_y,
            limits.acc_lim_theta,
            limits.min_vel_trans,
            limits.max_vel_trans,
            limits.min_vel_theta,
            p.sim_time,
            p.sim_granularity,
            p.angular_sim_granularity,
            not p.use_dwa,
        )


def velocity_window(velocity: Twist2D, limits: VelocityLimits, horizon: float) -> NDArray[np.float64]:
    """(3, 2) lowest and highest vx, vy, wz within the limits that are reachable within `horizon` (s).

    A robot outside its limits gets the nearest limit alone. The velocity is rounded to float32, as DWAPlanner::findBestPath
    stores it.
    """
    vx, vy, wz = np.array(velocity, np.float32).tolist()
    return np.array(
        (
            _reachable(vx, limits.min_vel_x, limits.max_vel_x, limits.acc_lim_x * horizon),
            _reachable(vy, limits.min_vel_y, limits.max_vel_y, limits.acc_lim_y * horizon),
            _reachable(wz, -limits.max_vel_theta, limits.max_vel_theta, limits.acc_lim_theta * horizon),
        )
    )


def _reachable(value: float, low: float, high: float, change: float) -> tuple[float, float]:
    bottom, top = max(low, value - change), min(high, value + change)
    if bottom > top:
        # ROS differs: C++ samples between the two, outside the limits (a vy of 0.001 for a robot that cannot strafe)
        bottom = top = min(max(value, low), high)
    return bottom, top


# --- kernels --------------------------------------------------------------------------------------------------------


@plain_kernel
def axis_values(low, high, number, out):
    """Write `number` values (at least 2), evenly spaced from low to high, to `out`, plus a 0 if the range crosses it.

    Returns how many (VelocityIterator of base_local_planner).
    """
    if low == high:
        out[0] = low
        return 1
    number = max(2, number)
    step = (high - low) / float(max(1, number - 1))
    value = low
    count = 0
    for _ in range(number - 1):
        out[count] = value
        count += 1
        following = value + step
        if value < 0.0 and following > 0.0:
            out[count] = 0.0
            count += 1
        value = following
    out[count] = high
    return count + 1


@plain_kernel
def sample_velocities(window, number_x, number_y, number_w, scratch, samples):
    """Write all combinations of the values of the three axes, vx outermost, to `samples`. Returns how many.

    `window` (3, 2): low and high of vx, vy, wz. `scratch` (3, m) holds the values of each axis.
    """
    f32 = np.float32
    nx = axis_values(np.float64(f32(window[0, 0])), np.float64(f32(window[0, 1])), number_x, scratch[0])
    ny = axis_values(np.float64(f32(window[1, 0])), np.float64(f32(window[1, 1])), number_y, scratch[1])
    nw = axis_values(np.float64(f32(window[2, 0])), np.float64(f32(window[2, 1])), number_w, scratch[2])
    k = 0
    for i in range(nx):
        vx = np.float64(f32(scratch[0, i]))
        for j in range(ny):
            vy = np.float64(f32(scratch[1, j]))
            for m in range(nw):
                samples[k, 0] = vx
                samples[k, 1] = vy
                samples[k, 2] = np.float64(f32(scratch[2, m]))
                k += 1
    return k


@plain_kernel
def count_points(samples, settings, counts):
    """Write the points per rollout to `counts`, 0 for samples outside the speed limits. Returns the largest count."""
    longest = 0
    for k in range(len(samples)):
        speed = math.hypot(samples[k, 0], samples[k, 1])
        turn = abs(samples[k, 2])
        points = 0
        too_slow = speed + EPS < settings.min_vel_trans and turn + EPS < settings.min_vel_theta
        if not too_slow and not speed - EPS > settings.max_vel_trans:
            along = speed * settings.sim_time / settings.sim_granularity
            around = turn * settings.sim_time / settings.angular_sim_granularity
            points = math.ceil(max(along, around))
        counts[k] = points
        longest = max(longest, points)
    return longest


@plain_kernel
def accelerate_towards(velocity, target, acceleration, dt):
    """Velocity of one axis after `dt` of acceleration towards `target`, rounded as C++ stores it."""
    if velocity < target:
        return np.float32(min(np.float64(target), velocity + acceleration * dt))
    return np.float32(max(np.float64(target), velocity - acceleration * dt))


@plain_kernel
def turned_steps(yaws, number, step, steps_x, steps_y):
    """Write `step` (m) in the directions of the first `number` of `yaws` (rad) to `steps_x`, `steps_y`; vectorized.

    Taylor polynomials after a reduction to at most pi / 4, with errors below HEADING_ERROR * step.
    """
    for i in range(np.uint64(number)):
        quarter = np.int32(yaws[i] * (2.0 / math.pi) + 4096.5) - np.int32(4096)
        r = (yaws[i] - quarter * HALF_PI_HIGH) - quarter * HALF_PI_LOW
        q = r * r
        s = 1 / 6227020800 + q * (-1 / 1307674368000 + q * (1 / 355687428096000))
        s = r * (1.0 + q * (-1 / 6 + q * (1 / 120 + q * (-1 / 5040 + q * (1 / 362880 + q * (-1 / 39916800 + q * s))))))
        c = -1 / 3628800 + q * (1 / 479001600 + q * (-1 / 87178291200 + q * (1 / 20922789888000)))
        c = 1.0 + q * (-1 / 2 + q * (1 / 24 + q * (-1 / 720 + q * (1 / 40320 + q * c))))
        odd = (quarter & np.int32(1)) != 0
        a, b = s if odd else c, c if odd else s
        steps_x[i] = step * (-a if ((quarter + np.int32(1)) & np.int32(2)) != 0 else a)
        steps_y[i] = step * (-b if (quarter & np.int32(2)) != 0 else b)


@plain_kernel
def integrate_forwards(x, y, yaw, vx, vw, dt, number, poses, k, buffers):
    """Write `number` poses with constant speeds vx, vw and vy = 0 to `poses[k]`, as `integrate`; return False if they are
    uncertain.

    Steps are computed with a small error. Where it does not change how a coordinate is rounded, the result is exact.
    `buffers` (3, T) is scratch.
    """
    yaws, steps_x, steps_y = buffers[0], buffers[1], buffers[2]
    farthest = abs(vx) * dt * number
    if not (abs(yaw) + abs(vw) * dt * number < 1000.0 and farthest < 1e6):
        return False
    f32 = np.float32
    error = np.float64(abs(vx)) * dt * HEADING_ERROR + 1e-15 * (abs(x) + abs(y) + farthest)
    for i in range(number):
        yaws[i] = yaw
        poses[k, i, 2] = yaw
        yaw = f32(yaw + vw * dt)
    turned_steps(yaws, number, np.float64(vx) * dt, steps_x, steps_y)
    differences = 0
    for i in range(number):
        poses[k, i, 0] = x
        poses[k, i, 1] = y
        next_x, next_y = x + steps_x[i], y + steps_y[i]
        x, y = f32(next_x - error), f32(next_y - error)
        differences += (x != f32(next_x + error)) | (y != f32(next_y + error))
    return differences == 0


@plain_kernel
def integrate(samples, pose, velocity, settings, counts, commands, poses, buffers):
    """Write the rollouts to `poses` (K, T, 3): the poses BEFORE each step, from `pose` on; the last pose is not scored.

    With `accelerate` the velocity approaches the sample at the acceleration limits; otherwise it equals the sample from the
    start. `pose`, `velocity`: three numbers each. `commands` (K, 3): the velocity of the first step.
    """
    sim_time, accelerate = settings.sim_time, settings.accelerate
    acc_x, acc_y, acc_theta = settings.acc_lim_x, settings.acc_lim_y, settings.acc_lim_theta
    f32 = np.float32
    half_pi = 0.5 * math.pi
    x0, y0, yaw0 = f32(pose[0]), f32(pose[1]), f32(pose[2])
    cos0, sin0 = math.cos(np.float64(yaw0)), math.sin(np.float64(yaw0))
    for k in range(len(samples)):
        tx, ty, tw = f32(samples[k, 0]), f32(samples[k, 1]), f32(samples[k, 2])
        n = counts[k]
        vx, vy, vw = tx, ty, tw
        dt = 0.0
        if n > 0:
            dt = sim_time / n
        if accelerate and n > 0:
            vx = accelerate_towards(f32(velocity[0]), tx, f32(acc_x), dt)
            vy = accelerate_towards(f32(velocity[1]), ty, f32(acc_y), dt)
            vw = accelerate_towards(f32(velocity[2]), tw, f32(acc_theta), dt)
        commands[k, 0] = vx
        commands[k, 1] = vy
        commands[k, 2] = vw
        x, y, yaw = x0, y0, yaw0
        done = False
        if n > FEWEST and not accelerate and vy == f32(0.0) and vx != f32(0.0):
            done = integrate_forwards(x, y, yaw, vx, vw, dt, n, poses, k, buffers)
        if done:
            continue
        c, s, at = cos0, sin0, yaw0
        for i in range(n):
            poses[k, i, 0] = x
            poses[k, i, 1] = y
            poses[k, i, 2] = yaw
            if i + 1 == n:
                break  # the pose after the last step is not scored
            if accelerate:
                vx = accelerate_towards(vx, tx, f32(acc_x), dt)
                vy = accelerate_towards(vy, ty, f32(acc_y), dt)
                vw = accelerate_towards(vw, tw, f32(acc_theta), dt)
            if vx != f32(0.0) or vy != f32(0.0):
                if yaw != at:
                    c, s, at = math.cos(np.float64(yaw)), math.sin(np.float64(yaw)), yaw
                if vy == f32(0.0):
                    x = f32(x + (vx * c) * dt)
                    y = f32(y + (vx * s) * dt)
                else:
                    left = half_pi + np.float64(yaw)
                    x = f32(x + (vx * c + vy * math.cos(left)) * dt)
                    y = f32(y + (vx * s + vy * math.sin(left)) * dt)
            yaw = f32(yaw + vw * dt)


@plain_kernel
def simulate(samples, x, y, yaw, vx, vy, wz, settings_, counts, commands, points, scratch):
    """`count_points` and `integrate`, from the pose x, y, yaw at the velocity vx, vy, wz. Returns T, the points per row.

    `settings_` (1,): see `SIMULATION_SETTINGS`. The poses (K, T, 3), T at least 1, are written to the beginning of `points`;
    nothing is integrated if `points` or `scratch` (3 * T,) is too small.
    """
    settings = settings_[0]
    longest = max(1, count_points(samples, settings, counts))
    number = len(samples)
    if number * longest * 3 <= len(points) and longest * 3 <= len(scratch):
        poses = points[: number * longest * 3].reshape(number, longest, 3)
        integrate(
            samples, (x, y, yaw), (vx, vy, wz), settings, counts, commands, poses, scratch.reshape(3, len(scratch) // 3)
        )
    return longest
