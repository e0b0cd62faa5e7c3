"""What Nav2 declares: the parameters of its nodes and classes by distribution, and the classes that navstack has.

The table is `declared.txt`. Sources: the declare_* calls of the branches foxy-devel to lyrical of navigation2.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple

NAV2_DISTROS: Final = ("foxy", "galactic", "humble", "iron", "jazzy", "kilted", "lyrical")
"""Distributions of ROS 2 that are known, oldest first."""
_INITIALS: Final = "FGHIJKL"
FOXY, GALACTIC, HUMBLE, IRON, JAZZY, KILTED, LYRICAL = range(7)

Type = Literal["bool", "int", "double", "string", "strings", "doubles", "ints"]
EVERY_NODE: Final = "every node"


class Declared(NamedTuple):
    """A parameter that Nav2 declares."""

    name: str
    """Below the block of its scope, with dots: `controller.k_phi`."""
    type: Type
    default: Any
    """None if it has none or if it is computed."""
    first: int
    last: int
    """Index of the first and of the last distribution that declares it."""
    counterpart: str
    """Name in navstack's section; a path from the section above if it has a slash; empty without one."""
    native: str = ""
    """The same in the plugin with Nav2's rules, if there is another one with the rules of ROS 1."""


@cache
def _table() -> Mapping[str, tuple[Declared, ...]]:
    scopes: dict[str, list[Declared]] = {}
    rows: list[Declared] = []
    for line in Path(__file__).with_name("declared.txt").read_text("utf-8").splitlines():
        if line.startswith("["):
            rows = scopes.setdefault(line[1:-1], [])
        elif line and not line.startswith("#"):
            rows.append(_row(line))
    return {scope: tuple(of_scope) for scope, of_scope in scopes.items()}


def _row(line: str) -> Declared:
    name, kind, default, (first, _, last), *counterparts = line.split()
    value = None if default in ("!", "*") else json.loads(default)
    made: Any = kind
    names = [{"=": name, "-": ""}.get(other, other) for other in counterparts or ("",)]
    return Declared(name, made, value, _INITIALS.index(first), _INITIALS.index(last), names[0], names[-1])


_INHERITED: Final[Mapping[str, tuple[str, ...]]] = {
    "nav2_controller::StoppedGoalChecker": ("nav2_controller::SimpleGoalChecker",),
    "nav2_controller::PoseProgressChecker": ("nav2_controller::SimpleProgressChecker",),
    "nav2_behaviors::BackUp": ("nav2_behaviors::DriveOnHeading",),
    **{f"nav2_costmap_2d::{name}Filter": ("costmap filter",) for name in ("Keepout", "Speed", "Binary")},
    "nav2_costmap_2d::ZoneParameterFilter": ("costmap filter",),
    **{f"dwb_critics::{name}Critic": ("dwb critic",) for name in ("Oscillation", "BaseObstacle", "PreferForward")},
    **{f"dwb_critics::{name}Critic": ("dwb critic",) for name in ("RotateToGoal", "Twirling")},
    "dwb_critics::ObstacleFootprintCritic": ("dwb_critics::BaseObstacleCritic", "dwb critic"),
    **{
        f"dwb_critics::{name}Critic": ("dwb map grid critic", "dwb critic")
        for name in ("PathDist", "GoalDist", "PathAlign", "GoalAlign")
    },
}
"""Scope -> further scopes, whose parameters it declares, too."""


def scopes() -> Iterator[str]:
    """Yield every node and class of the table."""
    yield from _table()


def every_row(scope: str) -> Iterator[Declared]:
    """Yield the parameters of a node or class in all distributions."""
    yield from _table().get(scope, ())
    for other in _INHERITED.get(scope, ()):
        yield from _table()[other]
    if scope.startswith("mppi::critics::"):
        yield from _table()["mppi critic"]


def is_known(scope: str) -> bool:
    """Return True for a node or class of the table."""
    return scope in _table() or scope in _INHERITED or scope in _WITHOUT_PARAMETERS


@cache
def declared(scope: str, distro: int) -> Mapping[str, Declared]:
    """Return what a node or class declares in a distribution, by name."""
    return {row.name: row for row in every_row(scope) if row.first <= distro <= row.last}


@cache
def declared_natively(scope: str, distro: int) -> Mapping[str, Declared]:
    """Return the same, each with its native counterpart as the counterpart."""
    return {name: row._replace(counterpart=row.native) for name, row in declared(scope, distro).items()}


# ----------------------------------------------------------------------------------------------------------------------
# Classes: kind -> class -> navstack's registered type; empty if navstack has nothing of that kind.


Kind = Literal[
    "controller",
    "planner",
    "smoother",
    "goal checker",
    "progress checker",
    "path handler",
    "layer",
    "filter",
    "behavior",
]

CLASSES: Final[Mapping[str, Mapping[str, str]]] = {
    "controller": {
        "dwb_core::DWBLocalPlanner": "dwb_core::DWBLocalPlanner",
        "nav2_mppi_controller::MPPIController": "nav2_mppi_controller::MPPIController",
        "nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController": (
            "nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController"
        ),
        "nav2_rotation_shim_controller::RotationShimController": "nav2_rotation_shim_controller::RotationShimController",
        "nav2_graceful_controller::GracefulController": "nav2_graceful_controller::GracefulController",
    },
    "planner": {
        "nav2_navfn_planner::NavfnPlanner": "navfn/NavfnROS",
        "nav2_smac_planner::SmacPlanner2D": "nav2_smac_planner::SmacPlanner2D",
        "nav2_smac_planner::SmacPlannerHybrid": "nav2_smac_planner::SmacPlannerHybrid",
        "nav2_smac_planner::SmacPlannerLattice": "nav2_smac_planner::SmacPlannerLattice",
        "smac_planner::SmacPlanner": "nav2_smac_planner::SmacPlannerHybrid",
        "smac_planner::SmacPlanner2D": "nav2_smac_planner::SmacPlanner2D",
        "nav2_theta_star_planner::ThetaStarPlanner": "theta_star",
    },
    "smoother": {
        "nav2_smoother::SimpleSmoother": "nav2_smoother::SimpleSmoother",
        "nav2_smoother::SavitzkyGolaySmoother": "nav2_smoother::SavitzkyGolaySmoother",
        "nav2_constrained_smoother::ConstrainedSmoother": "nav2_constrained_smoother::ConstrainedSmoother",
    },
    "goal checker": {
        f"nav2_controller::{name}GoalChecker": f"nav2_controller::{name}GoalChecker"
        for name in ("Simple", "Stopped", "Position", "Axis", "AdaptiveTolerance")
    },
    "progress checker": {
        f"nav2_controller::{name}ProgressChecker": f"nav2_controller::{name}ProgressChecker"
        for name in ("Simple", "Pose")
    },
    "path handler": {"nav2_controller::FeasiblePathHandler": "nav2_controller::FeasiblePathHandler"},
    "layer": {
        "nav2_costmap_2d::StaticLayer": "costmap_2d::StaticLayer",
        "nav2_costmap_2d::ObstacleLayer": "costmap_2d::ObstacleLayer",
        "nav2_costmap_2d::VoxelLayer": "costmap_2d::VoxelLayer",
        "nav2_costmap_2d::InflationLayer": "costmap_2d::InflationLayer",
        "nav2_costmap_2d::LegacyInflationLayer": "costmap_2d::InflationLayer",
        "nav2_costmap_2d::RangeSensorLayer": "range_sensor_layer::RangeSensorLayer",
        "nav2_costmap_2d::DenoiseLayer": "nav2_costmap_2d::DenoiseLayer",
        "spatio_temporal_voxel_layer::SpatioTemporalVoxelLayer": "spatio_temporal_voxel_layer/SpatioTemporalVoxelLayer",
        "nav2_costmap_2d::AsymmetricInflationLayer": "",
        "nav2_costmap_2d::PluginContainerLayer": "",
    },
    "filter": {
        "nav2_costmap_2d::KeepoutFilter": "nav2_costmap_2d::KeepoutFilter",
        "nav2_costmap_2d::SpeedFilter": "nav2_costmap_2d::SpeedFilter",
        "nav2_costmap_2d::BinaryFilter": "nav2_costmap_2d::BinaryFilter",
        "nav2_costmap_2d::ZoneParameterFilter": "",
    },
    "behavior": {
        "nav2_behaviors::Spin": "nav2_behaviors::Spin",
        "nav2_behaviors::BackUp": "nav2_behaviors::BackUp",
        "nav2_behaviors::DriveOnHeading": "nav2_behaviors::DriveOnHeading",
        "nav2_behaviors::Wait": "nav2_behaviors::Wait",
        "nav2_behaviors::AssistedTeleop": "nav2_behaviors::AssistedTeleop",
    },
    "navigator": {
        "nav2_bt_navigator::NavigateToPoseNavigator": "",
        "nav2_bt_navigator::NavigateThroughPosesNavigator": "",
    },
}
"""With the types of ROS 1 where there are two of a kind: what a robot of move_base has, and what becomes of it."""
NATIVE: Final[Mapping[str, Mapping[str, str]]] = {
    **CLASSES,
    "planner": {
        **CLASSES["planner"],
        "nav2_navfn_planner::NavfnPlanner": "nav2_navfn_planner::NavfnPlanner",
        "nav2_theta_star_planner::ThetaStarPlanner": "nav2_theta_star_planner::ThetaStarPlanner",
    },
    "layer": {
        **CLASSES["layer"],
        **{
            f"nav2_costmap_2d::{name}Layer": f"nav2_costmap_2d::{name}Layer"
            for name in ("Static", "Obstacle", "Voxel", "Inflation", "PluginContainer")
        },
        "nav2_costmap_2d::LegacyInflationLayer": "nav2_costmap_2d::InflationLayer",
    },
}
"""With the types that have Nav2's rules and Nav2's names of parameters: what a robot of Nav2 has."""
_WITHOUT_PARAMETERS: Final = frozenset(CLASSES["behavior"])
_SLASH_UP_TO_IRON: Final = ("planner", "behavior", "navigator")
"""Kinds whose classes are exported under names with a slash up to Iron."""


def canonical(written: str) -> str:
    """Return the name of a class as Jazzy writes it: `nav2_recoveries/Spin` -> nav2_behaviors::Spin."""
    return written.strip().replace("/", "::").replace("nav2_recoveries::", "nav2_behaviors::")


def exported_name(kind: str, name: str, distro: int) -> str:
    """Return the name under which a distribution exports a class (canonical name)."""
    if kind == "behavior" and distro <= GALACTIC:
        name = name.replace("nav2_behaviors::", "nav2_recoveries::")
    slash = (kind in _SLASH_UP_TO_IRON and distro <= IRON) or not name.startswith(("nav2_", "dwb_"))
    return name.replace("::", "/") if slash else name


# ----------------------------------------------------------------------------------------------------------------------
# Names that changed: scope -> previous name -> the current one, as a user writes it.


RENAMED: Final[Mapping[str, Mapping[str, str]]] = {
    "controller_server": {
        "goal_checker_plugin": "goal_checker_plugins (a list)",
        "progress_checker_plugin": "progress_checker_plugins (a list)",
    },
    "behavior_server": {
        "recovery_plugins": "behavior_plugins",
        "costmap_topic": "local_costmap_topic",
        "footprint_topic": "local_footprint_topic",
    },
    "bt_navigator": {
        "default_bt_xml_filename": "default_nav_to_pose_bt_xml",
        "error_code_names": "error_code_name_prefixes",
    },
    "layer source": {"obstacle_range": "obstacle_max_range", "raytrace_range": "raytrace_max_range"},
    "monitor polygon": {"max_points": "min_points (one more)"},
    "costmap": {"map_topic": "map_topic of the static layer"},
    "dwb_core::DWBLocalPlanner": {
        "max_rot_vel": "max_vel_theta",
        "min_trans_vel": "min_speed_xy",
        "max_trans_vel": "max_speed_xy",
        "min_rot_vel": "min_speed_theta",
        "prune_distance": "prune_distance of the path handler",
    },
    "nav2_mppi_controller::MPPIController": {
        **{
            name: f"{name} of the path handler"
            for name in (
                "prune_distance",
                "max_robot_pose_search_dist",
                "enforce_path_inversion",
                "inversion_xy_tolerance",
                "inversion_yaw_tolerance",
            )
        },
        "publish_critics_stats": "visualize",
        "AckermannConstraints.min_turning_r": "min_turning_r below the id of the motion model",
    },
    "nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController": {
        "desired_linear_vel": "max_linear_vel",
        "max_allowed_time_to_collision": "max_allowed_time_to_collision_up_to_carrot",
        "max_robot_pose_search_dist": "max_robot_pose_search_dist of the path handler",
    },
    "nav2_graceful_controller::GracefulController": {
        "motion_target_dist": "max_lookahead",
        "initial_rotation_min_angle": "initial_rotation_tolerance",
        "final_rotation": "prefer_final_rotation",
        "max_robot_pose_search_dist": "max_robot_pose_search_dist of the path handler",
    },
    "nav2_rotation_shim_controller::RotationShimController": {
        "primary_controller": "primary_controller.plugin, with the keys of that controller below primary_controller",
    },
}

ELOQUENT: Final = frozenset({"plugin_names", "plugin_types"})
"""Parameters that only Nav2 before Foxy has."""
