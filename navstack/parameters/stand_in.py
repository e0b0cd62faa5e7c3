"""Planners of move_base that navstack lacks: with `--allow-missing`, another one stands in with their limits and tolerances."""

from __future__ import annotations

import math
from typing import Any, Final

from navstack.parameters.findings import Finding, Location, finding
from navstack.parameters.foreign import FOREIGN_PLANNERS
from navstack.parameters.plugin_lists import mark_used, short_type
from navstack.parameters.tree import Space
from navstack.parameters.yaml_reader import ListNode, Node, ScalarNode
from navstack.plugins import GLOBAL_PLANNERS, LOCAL_PLANNERS

CONTROLLER: Final = "nav2_mppi_controller/MPPIController"
PLANNER: Final = "navfn/NavfnROS"
_SECTION: Final = "MPPIController"
_HORIZON_S: Final = 2.8
"""Duration of the simulated trajectories: the default of MPPI, 56 steps of 0.05 s."""
_CRITICS: Final = (
    "ConstraintCritic",
    "CostCritic",
    "GoalCritic",
    "GoalAngleCritic",
    "PathAlignCritic",
    "PathFollowCritic",
    "PathAngleCritic",
)
"""Those of a car, which has to drive backward: without PreferForwardCritic."""
_TAKEN: Final = {
    "vx_max": ("max_vel_x", 1.0),
    "vx_min": ("max_vel_x_backwards", -1.0),
    "vy_max": ("max_vel_y", 1.0),
    "wz_max": ("max_vel_theta", 1.0),
    "ax_max": ("acc_lim_x", 1.0),
    "ax_min": ("acc_lim_x", -1.0),
    "ay_max": ("acc_lim_y", 1.0),
    "az_max": ("acc_lim_theta", 1.0),
}
"""Parameter of the controller that stands in -> that of TebLocalPlannerROS, and its sign."""


def stand_in(root: Space) -> list[Finding]:
    """Write planners that navstack has in place of those that it lacks; return a warning about each.

    The controller takes speeds, accelerations, turning radius and goal tolerances of the one that it replaces.
    """
    found: list[Finding] = []
    for registry, key, other in (
        (GLOBAL_PLANNERS, "base_global_planner", PLANNER),
        (LOCAL_PLANNERS, "base_local_planner", CONTROLLER),
    ):
        leaf = root.leaf(key)
        if leaf is None or not isinstance(leaf.value, str) or leaf.value in registry:
            continue
        name = short_type(leaf.value)
        if name not in FOREIGN_PLANNERS:
            continue  # maybe a misspelt name
        at = leaf.node.at
        message = f'navstack has no {registry.kind} "{leaf.value}", so {other} stands in'
        space = root.space(name)
        if registry is LOCAL_PLANNERS:
            message += ", with the limits and tolerances of its section" if space is not None else ""
            _take_over(root, space, at)
        found.append(finding("warning", "substituted-planner", at, key, message))
        mark_used(root, name)
        root.put(key, at, _scalar(other, at))
    return found


def _take_over(root: Space, given: Space | None, at: Location) -> None:
    """Write the section of the controller that stands in for the planner of a section."""
    made = root.ensure(_SECTION, at)
    frequency = _number(root, "controller_frequency") or 20.0
    period = 1.0 / frequency if frequency > 0.0 else 0.05
    made.put("model_dt", at, _scalar(period, at))
    made.put("time_steps", at, _scalar(max(8, round(_HORIZON_S / period)), at))
    for checked in ("CostCritic", "TrajectoryValidator"):
        made.ensure(checked, at).put("consider_footprint", at, _scalar(True, at))
    backward = given is not None and (_number(given, "min_turning_radius") or 0.0) > 0.0
    critics = _CRITICS if backward else (*_CRITICS, "PreferForwardCritic")
    made.put("critics", at, ListNode([_scalar(critic, at) for critic in critics], at))
    if given is None:
        return
    for name, (theirs, sign) in _TAKEN.items():
        leaf, value = given.leaf(theirs), _number(given, theirs)
        if leaf is not None and value is not None and (value > 0.0 or name in ("vx_min", "vy_max")):
            made.put(name, leaf.at, _scalar(sign * value, leaf.at))
    sideways, radius = _number(given, "max_vel_y") or 0.0, _number(given, "min_turning_radius") or 0.0
    if radius > 0.0:
        made.put("motion_model", at, _scalar("Ackermann", at))
        made.ensure("AckermannConstraints", at).put("min_turning_r", at, _scalar(radius, at))
        sim = root.ensure("navstack", at).ensure("sim", at)
        if sim.leaf("kinematics") is None:
            sim.put("kinematics", at, _scalar("ackermann", at))
            wheelbase = _number(given, "wheelbase") or 0.5
            sim.put("wheelbase", at, _scalar(wheelbase, at))
            sim.put("max_steering_angle", at, _scalar(min(1.5, math.atan(wheelbase / (0.95 * radius))), at))
            sim.put("min_turning_radius", at, _scalar(radius, at))
    elif sideways > 0.0:
        made.put("motion_model", at, _scalar("Omni", at))
    if root.space("goal_checker") is None:
        checker = root.ensure("goal_checker", at)
        checker.put("plugin", at, _scalar("nav2_controller::SimpleGoalChecker", at))
        for name in ("xy_goal_tolerance", "yaw_goal_tolerance"):
            value = _number(given, name)
            if value is not None:
                checker.put(name, at, _scalar(value, at))


def _number(space: Space, name: str) -> float | None:
    leaf = space.leaf(name)
    value = leaf.value if leaf is not None else None
    return float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else None


def _scalar(value: Any, at: Location) -> Node:
    return ScalarNode(value, at, isinstance(value, str), str(value))
