"""Parameters of TrajectoryPlannerROS."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import ClassVar

from pydantic import field_validator

from navstack.core.parameter_checks import CheckContext, Issue
from navstack.core.parameters import ParamModel, param
from navstack.local_planner import parameter_checks as checks
from navstack.local_planner.critics._weights import RosDistro


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
        "measure distances in metres instead of cells",
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
        yield from checks.window_too_small(context, self.sim_time, self.max_vel_x)
        yield from checks.updates_too_slow(context, self.max_vel_x)
        yield from checks.stopping_time(self.acc_lim_x, self.max_vel_x, self.sim_time)
        yield from checks.minimum_over_maximum(
            [
                ("min_vel_x", self.min_vel_x, "max_vel_x", self.max_vel_x),
                ("min_vel_theta", self.min_vel_theta, "max_vel_theta", self.max_vel_theta),
            ]
        )
        yield from checks.goal_tolerances(context, self.xy_goal_tolerance, self.yaw_goal_tolerance, self.min_vel_theta)

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
