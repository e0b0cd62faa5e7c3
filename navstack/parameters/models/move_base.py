"""The parameters of move_base itself (ROS: move_base/src/move_base.cpp, move_base/cfg/MoveBase.cfg)."""

from collections.abc import Mapping
from typing import Any, ClassVar, Final

from pydantic import field_validator

from navstack.parameters.sections import first_of, section_model
from navstack.plugins import PROGRESS_CHECKERS, ParamModel, PluginSpec, ProgressChecker, param

PROGRESS_CHECKER: Final = "progress_checker"
DEFAULT_PROGRESS_CHECKER: Final = "nav2_controller::SimpleProgressChecker"

SLOWEST_HZ: Final = 0.001
"""Minimum control frequency: a goal ends in a control cycle, so at a lower one it would not end."""
AGGRESSIVE_RESET_RADII = 4.0
"""Side of the square that the built-in aggressive_reset keeps, in circumscribed radii."""


class MoveBaseParams(ParamModel):
    """Namespace `move_base`. The defaults are those that a user of noetic gets with an empty YAML.

    Keys that move_base reads from the namespaces of its costmaps (`circumscribed_radius`, `robot_base_frame`,
    `global_frame`) belong to the costmaps. The circumscribed radius is not read: it is computed from the footprint.
    """

    NO_EFFECT: ClassVar[Mapping[str, str]] = {
        "restore_defaults": "a button of dynamic_reconfigure, not a parameter",
    }

    CHILD_FIELD: ClassVar[str | None] = "sections"

    # lower values have the effect of the lowest one; move_base uses values over the sliders until the first reconfiguration
    CLAMPED: ClassVar[frozenset[str]] = frozenset(
        {
            "planner_frequency",
            "planner_patience",
            "controller_patience",
            "max_planning_retries",
            "oscillation_timeout",
            "oscillation_distance",
        }
    )
    base_global_planner: str = param("navfn/NavfnROS", "global planner plugin")
    base_smoother: str | None = param(
        None,
        "smoother of the plans, with its parameters in the section of its name; none by default",
        ros_differs="does not exist in ROS 1",
    )
    base_local_planner: str = param("base_local_planner/TrajectoryPlannerROS", "local planner plugin")
    recovery_behaviors: list[PluginSpec] | None = param(
        None,
        "recovery behaviors in the order in which they run; if not set, the built-in list",
        ros_differs="an unknown type is an error; ROS uses the built-in list",
    )
    planner_frequency: float = param(
        0.0, "frequency of replanning while driving; 0 = only when needed", unit="Hz", ge=0.0
    )
    controller_frequency: float = param(
        20.0,
        "frequency of control cycles",
        unit="Hz",
        gt=0.0,
        le=1000.0,
        ros_differs="0 is an error; ROS divides by 0",
    )
    planner_patience: float = param(5.0, "maximum time without a valid plan before a recovery", unit="s", ge=0.0)
    controller_patience: float = param(
        15.0,
        "maximum time without a valid command or current sensor data before a recovery or abort",
        unit="s",
        ge=0.0,
        ros_differs="in ROS, the first dynamic_reconfigure call changes the default from 15.0 to 5.0; ROS waits for sensor data "
        "without limit",
    )
    max_planning_retries: int = param(
        -1, "consecutive planning failures before a recovery; -1 = only planner_patience applies", ge=-1
    )
    oscillation_timeout: float = param(
        0.0, "maximum time without progress before a recovery; 0 = no limit", unit="s", ge=0.0
    )
    oscillation_distance: float = param(
        0.5,
        "distance that counts as progress",
        unit="m",
        ge=0.0,
        ros_differs="rotation in place also counts as progress, up to one full turn",
    )
    conservative_reset_dist: float = param(
        3.0,
        "side of the square that the built-in conservative_reset keeps",
        unit="m",
        ge=0.0,
    )
    recovery_behavior_enabled: bool = param(True, "run recovery behaviors")
    clearing_rotation_allowed: bool = param(True, "the built-in recoveries include rotation in place")
    shutdown_costmaps: bool = param(False, "costmaps are updated only while a goal is active")
    make_plan_clear_costmap: bool = param(True, "clear the costmaps around the robot before make_plan")
    make_plan_add_unreachable_goal: bool = param(True, "append the goal to a plan that ends near it")
    clearing_radius: float | None = param(
        None,
        "half the side of the square that make_plan clears; if not set, the circumscribed radius of the footprint",
        unit="m",
        ge=0.0,
        ros_differs="ROS uses the constant local_costmap/circumscribed_radius (0.46) for every footprint",
    )

    progress_checker_plugins: list[str] | None = param(
        None,
        "namespace of a progress checker, as in Nav2's controller_server; if not set, that of `progress_checker` if it is "
        "written; the first of the list is used, an empty list switches it off",
    )
    sections: dict[str, Any] = param({}, "parameters of the progress checker, from its namespace")

    @classmethod
    def child_models(cls, values: Mapping[str, Any]) -> dict[str, type[ParamModel]]:
        """The model of the progress checker, if there is one."""
        if values.get("progress_checker_plugins") is None and not isinstance(values.get(PROGRESS_CHECKER), Mapping):
            return {}
        if values.get("progress_checker_plugins") == []:
            return {}
        name = first_of(values, "progress_checker_plugins", PROGRESS_CHECKER)
        return {name: section_model(PROGRESS_CHECKERS, values, name, DEFAULT_PROGRESS_CHECKER)}

    def make_progress_checker(self) -> ProgressChecker | None:
        """The progress checker of these parameters; None without one."""
        for params in self.sections.values():
            return PROGRESS_CHECKERS.get(params.plugin or DEFAULT_PROGRESS_CHECKER).cls(params)
        return None

    @field_validator("controller_frequency")
    @classmethod
    def _check_minimum(cls, value: float) -> float:
        if value < SLOWEST_HZ:
            raise ValueError(
                f"controller_frequency = {value:g} Hz gives one control cycle in {1.0 / value:.3g} s, so goals do not end; set "
                f"it to {SLOWEST_HZ:g} Hz or more"
            )
        return value


def builtin_recoveries(params: MoveBaseParams, circumscribed_radius: float) -> list[tuple[PluginSpec, dict[str, Any]]]:
    """Return the recoveries of a robot without `recovery_behaviors`, in order, with the parameters that the list sets.

    conservative_reset, rotate_recovery, aggressive_reset, rotate_recovery; the rotations only if
    `clearing_rotation_allowed`. `circumscribed_radius` (m) is that of the padded footprint. The parameters set here
    override the YAML, as in ROS (move_base.cpp, loadDefaultRecoveryBehaviors).

    ROS differs: aggressive_reset keeps four times the constant 0.46 m for every footprint (parity 21).
    """
    clear, rotate = "clear_costmap_recovery/ClearCostmapRecovery", "rotate_recovery/RotateRecovery"
    aggressive = AGGRESSIVE_RESET_RADII * circumscribed_radius
    found: list[tuple[PluginSpec, dict[str, Any]]] = [
        (PluginSpec(name="conservative_reset", type=clear), {"reset_distance": params.conservative_reset_dist}),
        (PluginSpec(name="rotate_recovery", type=rotate), {}),
        (PluginSpec(name="aggressive_reset", type=clear), {"reset_distance": aggressive}),
        (PluginSpec(name="rotate_recovery", type=rotate), {}),
    ]
    if not params.clearing_rotation_allowed:
        return [entry for entry in found if entry[0].type != rotate]
    return found


# ----------------------------------------------------------------------------------------------------------------------
# Parameters of a costmap: `global_costmap:` and `local_costmap:` (costmap_2d/src/costmap_2d_ros.cpp, cfg/Costmap2D.cfg).


class CostmapParams(ParamModel):
    """Parameters of a costmap; each of its layers has its own namespace below."""

    global_frame: str = param("map", "frame of the costmap")
    robot_base_frame: str = param("base_link", "frame of the robot's center")
    rolling_window: bool = param(False, "the costmap is a window that follows the robot")
    track_unknown_space: bool = param(False, "unobserved cells are unknown (255) instead of free (0)")
    always_send_full_costmap: bool = param(False, "publish the whole grid instead of the part that changed")
    plugins: list[PluginSpec] | None = param(None, "layers, in the order in which they write")
    footprint_topic: str = param("footprint", "topic on which a new footprint is received")
    published_footprint_topic: str = param("footprint", "topic on which the footprint is published")
    transform_tolerance: float = param(0.3, "maximum age of the robot's pose", unit="s", ge=0.0, le=10.0)
    update_frequency: float = param(5.0, "frequency of updates; 0 = never", unit="Hz", ge=0.0, le=100.0)
    publish_frequency: float = param(0.0, "frequency of publishing; 0 = never", unit="Hz", ge=0.0, le=100.0)
    width: float = param(
        10.0, "size along x; a static map overrides it", unit="m", ge=0.0, ros_differs="ROS reads an integer"
    )
    height: float = param(
        10.0, "size along y; a static map overrides it", unit="m", ge=0.0, ros_differs="ROS reads an integer"
    )
    resolution: float = param(
        0.05, "size of a cell; a static map overrides it", unit="m", gt=0.0, le=50.0, ros_differs="ROS accepts 0"
    )
    origin_x: float = param(0.0, "x of the lower left corner; a static map overrides it", unit="m")
    origin_y: float = param(0.0, "y of the lower left corner; a static map overrides it", unit="m")
    footprint: list[list[float]] | str = param("[]", "footprint of the robot, [[x, y], ..] with at least three points")
    robot_radius: float = param(
        0.46, "radius of a round robot, used if the footprint is empty", unit="m", ge=0.0, le=10.0
    )
    footprint_padding: float = param(0.01, "padding of the footprint along each axis", unit="m")

    CLAMPED: ClassVar[frozenset[str]] = frozenset(
        {"transform_tolerance", "update_frequency", "publish_frequency", "width", "height", "resolution"}
    )
    SEARCHED: ClassVar[frozenset[str]] = frozenset({"footprint", "robot_radius"})
    NO_EFFECT: ClassVar[Mapping[str, str]] = {
        "static_map": "ignored because plugins is set; list a static layer instead",
        "map_type": "ignored because plugins is set; list an obstacle or voxel layer instead",
        "inscribed_radius": "computed from the footprint",
        "circumscribed_radius": "computed from the footprint",
    }
