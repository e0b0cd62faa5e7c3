"""The parameters of move_base itself (ROS: move_base/src/move_base.cpp, move_base/cfg/MoveBase.cfg)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Final

from pydantic import field_validator

from navstack.core.parameters import ParamModel, PluginSpec, param

SLOWEST_HZ: Final = 0.001
"""Slowest control: a goal ends in a control cycle, so that a slower one would never end."""
AGGRESSIVE_RESET_RADII = 4.0
"""The side of the square that the built-in aggressive_reset keeps, in circumscribed radii."""


class MoveBaseParams(ParamModel):
    """Namespace `move_base`. Defaults are what a user of noetic gets with an empty YAML.

    The keys that move_base reads from its costmaps' namespaces (`circumscribed_radius`, `robot_base_frame`,
    `global_frame`) belong to those. The circumscribed radius is not read at all: it follows from the footprint.
    """

    NO_EFFECT: ClassVar[Mapping[str, str]] = {
        "restore_defaults": "a button of dynamic_reconfigure, not a setting",
    }

    base_global_planner: str = param("navfn/NavfnROS", "global planner plugin")
    base_local_planner: str = param("base_local_planner/TrajectoryPlannerROS", "local planner plugin")
    recovery_behaviors: list[PluginSpec] | None = param(
        None,
        "recovery behaviours in the order in which they are tried; without it, the built-in list",
        ros_differs="a list that cannot be used is an error; ROS falls back to the built-in list",
    )
    planner_frequency: float = param(
        0.0, "how often to replan while driving; 0 = only when needed", unit="Hz", ge=0.0, le=100.0
    )
    controller_frequency: float = param(
        20.0,
        "control cycles per second",
        unit="Hz",
        gt=0.0,
        le=100.0,
        ros_differs="0 is an error; ROS then divides by it",
    )
    planner_patience: float = param(
        5.0, "how long to go without a valid plan before recovering", unit="s", ge=0.0, le=100.0
    )
    controller_patience: float = param(
        15.0,
        "how long to go without a valid command, or without fresh sensor data, before recovering or giving up",
        unit="s",
        ge=0.0,
        le=100.0,
        ros_differs="in ROS 15.0 holds until the first dynamic reconfigure call, which applies 5.0 when this is not set; "
        "and ROS waits for ever for sensor data",
    )
    max_planning_retries: int = param(
        -1, "failed plans in a row before recovering; -1 = only patience counts", ge=-1, le=1000
    )
    oscillation_timeout: float = param(
        0.0, "how long to go without progress before recovering; 0 = for ever", unit="s", ge=0.0, le=60.0
    )
    oscillation_distance: float = param(
        0.5,
        "motion that counts as progress",
        unit="m",
        ge=0.0,
        le=10.0,
        ros_differs="turning in place counts as progress too, up to a full turn",
    )
    conservative_reset_dist: float = param(
        3.0,
        "side of the square that conservative_reset of the built-in recoveries keeps",
        unit="m",
        ge=0.0,
        le=50.0,
    )
    recovery_behavior_enabled: bool = param(True, "run recovery behaviours at all")
    clearing_rotation_allowed: bool = param(True, "the built-in recoveries include turning in place")
    shutdown_costmaps: bool = param(False, "costmaps are updated only while there is a goal")
    make_plan_clear_costmap: bool = param(True, "clear the costmaps around the robot before make_plan")
    make_plan_add_unreachable_goal: bool = param(True, "append the goal itself to a plan that ends near it")
    clearing_radius: float | None = param(
        None,
        "half the side of the square that make_plan clears; without it, the circumscribed radius of the footprint",
        unit="m",
        ge=0.0,
        ros_differs="ROS takes the constant local_costmap/circumscribed_radius (0.46) whatever the footprint",
    )

    @field_validator("controller_frequency")
    @classmethod
    def _ends(cls, value: float) -> float:
        if value < SLOWEST_HZ:
            raise ValueError(
                f"controller_frequency = {value:g} Hz is a cycle in {1.0 / value:.3g} s, and a goal ends in none before; "
                f"give {SLOWEST_HZ:g} Hz or more"
            )
        return value


def builtin_recoveries(params: MoveBaseParams, circumscribed_radius: float) -> list[tuple[PluginSpec, dict[str, Any]]]:
    """The recoveries of a robot whose YAML names none, in order, each with the parameters that the list imposes.

    `circumscribed_radius` (m) is that of the padded footprint. conservative_reset, rotate_recovery, aggressive_reset,
    rotate_recovery; the rotations only where `clearing_rotation_allowed`. An imposed parameter overrides the YAML's, as
    in ROS (move_base.cpp, loadDefaultRecoveryBehaviors).

    ROS differs: aggressive_reset keeps four times the constant 0.46 m, whatever the footprint (parity 21).
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
