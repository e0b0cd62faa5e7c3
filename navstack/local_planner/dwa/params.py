"""Parameters of DWAPlannerROS."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

from navstack.core.parameter_checks import CheckContext, Issue
from navstack.core.parameters import ParamModel, PluginSpec, param
from navstack.local_planner import parameter_checks as checks
from navstack.local_planner.critics._weights import RosDistro
from navstack.plugins import CRITICS


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
    path_distance_bias: float = param(
        0.6, "weight of the distance to the plan, per metre (32 before 2018: see ros_distro)", ge=0.0
    )
    goal_distance_bias: float = param(
        0.8, "weight of the distance to the local goal, per metre (24 before 2018: see ros_distro)", ge=0.0
    )
    occdist_scale: float = param(0.01, "weight of the obstacle cost", ge=0.0)
    twirling_scale: float = param(0.0, "weight of the turning speed: prevents holonomic robots from spinning", ge=0.0)
    oscillation_reset_dist: float = param(0.05, "motion that allows every direction again", unit="m", ge=0.0)
    oscillation_reset_angle: float = param(0.2, "turn that allows every direction again", unit="rad", ge=0.0)
    forward_point_distance: float = param(0.325, "distance of the nose from the robot's centre", unit="m")
    cheat_factor: float = param(
        1.0, "factor on the squared forward_point_distance within which alignment is off near the goal", ge=0.0
    )
    scaling_speed: float = param(0.25, "speed above which the footprint grows", unit="m/s", ge=0.0)
    max_scaling_factor: float = param(0.2, "growth of the footprint at max_vel_trans", ge=0.0)
    vx_samples: int = param(3, "number of velocities along x (at least 2 are used)", ge=1)
    vy_samples: int = param(
        10, "number of velocities along y (at least 2 are used if the limits differ); 0 counts as 1, as in ROS", ge=0
    )
    vth_samples: int = param(20, "number of turning speeds (at least 2 are used)", ge=1)
    use_dwa: bool = param(True, "sample velocities reachable within one period; otherwise within sim_time")
    sum_scores: bool = param(False, "sum of the obstacle costs along a trajectory instead of their maximum")
    controller_frequency: float = param(20.0, "control cycles per second; 0 counts as 20", unit="Hz", ge=0.0)
    ros_distro: RosDistro = param(
        "noetic",
        "scoring scale of noetic, or of the releases before 2018 (indigo), for which most published YAML was tuned",
    )
    publish_traj_pc: bool = param(False, "publish the legal trajectories on trajectory_cloud (ROS 1 node)")
    publish_cost_grid_pc: bool = param(False, "publish the costs of the cells on cost_cloud (ROS 1 node)")
    global_frame_id: str = param("odom", "frame of trajectory_cloud (ROS 1 node)")
    odom_topic: str = param("odom", "topic of the odometry (ROS 1 node)")
    critics: list[PluginSpec] | None = param(
        None, "ordered critics instead of the seven of move_base: a list of {name, type}; an addition of navstack"
    )
    critic_params: dict[str, Any] = param({}, "parameters of listed critics, from the namespaces of their names")

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
        yield from checks.window_too_small(context, self.sim_time, self.max_vel_x, self.forward_point_distance)
        yield from checks.updates_too_slow(context, self.max_vel_x)
        if self.use_dwa:
            yield from checks.cannot_start(
                context, self.acc_lim_x, self.acc_lim_theta, self.min_vel_trans, self.min_vel_theta
            )
        yield from checks.stopping_time(self.acc_lim_x, self.max_vel_x, self.sim_time)
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

    def _check_scoring_scale(self, context: CheckContext) -> Iterator[Issue]:
        resolution = context.local_costmap.resolution
        obstacle = self.occdist_scale * checks.INSCRIBED_COST
        # the goal and goal_front critics both fall by a metre's worth
        noetic, indigo = (2.0 * self.goal_distance_bias, obstacle), (self.goal_distance_bias, obstacle * resolution)
        return checks.scoring_scale(
            context,
            horizon=self.sim_time * self.max_vel_x,
            goal_distance_bias=self.goal_distance_bias,
            occdist_scale=self.occdist_scale,
            score=indigo if context.ros_distro == "indigo" else noetic,
            indigo_score=indigo,
            factor=1.0 / (2.0 * resolution),
        )
