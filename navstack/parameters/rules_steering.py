"""Rules of a base with a turning radius, a car: with controller, planner, path handler and recovery behaviors."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np

from navstack.core import reversals
from navstack.parameters.configuration_types import Configuration
from navstack.plugins import GLOBAL_PLANNERS, Problem, rule

SAME_M = 1e-3
"""Difference of two radii that counts as none (m)."""


@rule("turns-too-tight", "warning")
def controller_too_tight(configuration: Configuration) -> Iterator[Problem]:
    """The controller commands turns in place, or curves below the turning radius of the simulated base (`kinematics:
    ackermann` or `tricycle`), which then drives another trajectory than the one that was checked for collisions.
    DWA, for one, has no turning radius.

    Fix: MPPI with `motion_model: Ackermann`, or regulated pure pursuit without `use_rotate_to_heading`, each with
    `min_turning_r`.
    """
    sim, local = configuration.navstack.sim, configuration.local_planner
    params: Any = local.params
    controller = float(getattr(params, "turning_radius", 0.0))
    if sim.turning_radius <= controller + SAME_M:
        return
    need = f"{math.ceil(100.0 * sim.turning_radius - 1e-6) / 100.0:g}"
    if hasattr(params, "motion_model"):
        names, fix = ("motion_model",), f"set motion_model: Ackermann with min_turning_r: {need}"
        if controller > 0.0:
            names, fix = (f"{params.motion_model}/min_turning_r", "motion_model"), f"set min_turning_r to {need}"
    elif hasattr(params, "min_turning_r"):
        names, fix = ("min_turning_r", "use_rotate_to_heading"), f"set min_turning_r to {need}"
        if params.use_rotate_to_heading:
            fix += " and use_rotate_to_heading to false"
    else:
        names = ()
        fix = f"use mppi with motion_model: Ackermann, or regulated_pure_pursuit, each with min_turning_r: {need}"
    what = f"curves of {controller:g} m" if controller > 0.0 else "turns in place and curves of any radius"
    message = (
        f"{local.name} commands {what}, but the base (navstack/sim/kinematics {sim.kinematics}) turns on "
        f"{sim.turning_radius:.3g} m at least, so it leaves the trajectory that was checked; {fix}"
    )
    written = (*(f"/{local.namespace}/{n}" for n in names), "/base_local_planner", "/navstack/sim/kinematics")
    yield Problem(written, message, need if controller > 0.0 else None)


@rule("planner-turning-radius", "warning")
def planner_too_tight(configuration: Configuration) -> Iterator[Problem]:
    """A base with a turning radius cannot hold the path of its planner: a planner on the cells of the costmap plans
    corners and ignores the heading, `minimum_turning_radius` is too small, or an arc of `given_path` is too tight;
    the message names the arc and where it begins. While driving, `navstack explain goal` names the first curve of
    each plan that is too tight.

    Fix: a planner that keeps to the turning radius.
    """
    radius, planner = configuration.turning_radius, configuration.global_planner
    params = planner.params
    own = getattr(params, "minimum_turning_radius", getattr(params, "turning_radius", 0.0))
    if radius <= 0.0 or float(own) >= radius - SAME_M:
        return
    if hasattr(params, "segments"):
        place, number, tightest = _tightest_segment(params)
        message = (
            f"segment {number} of {planner.name} turns on {tightest:.3g} m from ({place[0]:.2f}, {place[1]:.2f}) on, but the "
            f"base turns on {radius:.3g} m at least, so it leaves the path there; set its curvature to at most "
            f"{math.floor(100.0 / radius) / 100.0:g} 1/m"
        )
        yield Problem((f"/{planner.namespace}/segments",), message)
    elif hasattr(params, "minimum_turning_radius"):
        message = (
            f"minimum_turning_radius = {float(own):g} m of {planner.name} is under the turning radius of {radius:.3g} m of base "
            f"and controller, which cannot hold such a path; set it to {radius:.3g}"
        )
        names = (f"/{planner.namespace}/minimum_turning_radius",)
        yield Problem(names, message, f"{radius:.3g}")
    else:
        known = [e.name for e in GLOBAL_PLANNERS if "minimum_turning_radius" in e.cls.Params.model_fields]
        others = " or ".join([*known, "given_path"])
        message = (
            f"{planner.name} plans paths with corners and without regard to the heading, so a base with a turning radius of "
            f"{radius:.3g} m leaves them; set base_global_planner to {others}"
        )
        yield Problem(("/base_global_planner",), message, known[0] if known else None)


def _tightest_segment(params: Any) -> tuple[list[float], int, float]:
    """First pose, number and radius (m) of the tightest arc of a given path."""
    number = max(range(len(params.segments)), key=lambda k: abs(params.segments[k][1]))
    before = params.model_copy(update={"segments": params.segments[:number]})
    return before.poses()[-1].tolist(), number + 1, 1.0 / abs(params.segments[number][1])


@rule("recovery-turns-in-place", "warning")
def recoveries_turn(configuration: Configuration) -> Iterator[Problem]:
    """A base with a turning radius cannot turn in place, so `rotate_recovery` and `spin` recover nothing. They refuse
    (CANNOT_TURN_IN_PLACE) if the controller has a turning radius; `back_up`, `drive_on_heading` and
    `clear_costmap_recovery` are fine.

    Fix: list `recovery_behaviors` without them, or set `clearing_rotation_allowed` to false.
    """
    radius = configuration.turning_radius
    built_in = "recovery_behaviors" not in configuration.move_base.model_fields_set
    for recovery in configuration.recoveries:
        if radius <= 0.0 or not recovery.cls.turns_in_place:
            continue
        fix = "set clearing_rotation_allowed to false" if built_in else "remove it from recovery_behaviors"
        message = (
            f"{recovery.name} turns in place, which a base with a turning radius of {radius:.3g} m cannot, so it recovers "
            f"nothing; {fix}"
        )
        names = ("/clearing_rotation_allowed",) if built_in else ("/recovery_behaviors",)
        yield Problem((*names, "/navstack/sim/kinematics"), message)


@rule("cannot-reverse", "warning")
def cannot_reverse(configuration: Configuration) -> Iterator[Problem]:
    """The path changes its direction, but the controller drives forward only.

    Fix: `vx_min` below 0 (MPPI), or `allow_reversing` without `use_rotate_to_heading` (regulated pure pursuit).
    """
    planner, local = configuration.global_planner, configuration.local_planner
    place = _first_reversal(planner.params) if configuration.turning_radius > 0.0 else None
    params: Any = local.params
    if place is None or getattr(params, "drives_backward", True):
        return
    name = next((n for n in ("allow_reversing", "vx_min", "allow_backward") if hasattr(params, n)), "")
    if not name:
        fix = "use a controller that does"
    elif getattr(params, name) is True:
        fix = f"heed the warning on {name} of {local.name}"
    else:
        fix = f"set {name} of {local.name} so that it does"
    message = (
        f"the path of {planner.name} changes its direction{place}, but {local.name} does not drive backward; {fix}, or plan "
        "without reversing"
    )
    written = f"/{local.namespace}/{name}" if name else "/base_local_planner"
    yield Problem((written, "/base_local_planner"), message)


@rule("path-under-footprint", "warning")
def path_under_footprint(configuration: Configuration) -> Iterator[Problem]:
    """The pieces of a path before and after a change of direction lie on top of each other, both under the robot's
    footprint. A controller that gets the whole path takes the nearest pose of either piece and cuts the turning
    point, or drives on where it should turn back. A piece that is no longer than `inversion_xy_tolerance` counts
    as driven when it begins.

    Fix: set `enforce_path_inversion` of the path handler to true; lower `inversion_xy_tolerance`.
    """
    planner = configuration.global_planner
    params: Any = configuration.local_planner.params
    place = _first_reversal(planner.params) if configuration.turning_radius > 0.0 else None
    if place is None:
        return
    handler = params.make_path_handler() if hasattr(params, "make_path_handler") else None
    cuts: Any = getattr(handler, "params", None)
    if cuts is None or not hasattr(cuts, "enforce_path_inversion"):
        return
    if not cuts.enforce_path_inversion:
        corners = configuration.local_costmap.footprint.vertices
        length, width = (float(v) for v in np.ptp(corners, axis=0))
        message = (
            f"the path of {planner.name} changes its direction{place}, and its pieces before and after overlap under the "
            f"footprint of {length:.2f} x {width:.2f} m, so the controller takes the nearest pose of either piece and "
            "cuts the turning point; set enforce_path_inversion to true"
        )
        yield Problem(("/PathHandler/enforce_path_inversion",), message, "true")
        return
    short = _shortest_piece(planner.params)
    if short is not None and short[0] <= cuts.inversion_xy_tolerance:
        length, (x, y) = short
        message = (
            f"the piece of {length:.2f} m between two changes of direction at ({x:.2f}, {y:.2f}) is no longer than "
            f"inversion_xy_tolerance = {cuts.inversion_xy_tolerance:g} m, so it counts as driven when it begins; set the "
            f"tolerance to {0.5 * length:.2g}, or lengthen the piece"
        )
        yield Problem(("/PathHandler/inversion_xy_tolerance",), message)


def _first_reversal(params: Any) -> str | None:
    """Where a planner's path turns back: ` at (x, y)`, empty if it may anywhere; None if it never does."""
    if hasattr(params, "segments"):
        poses = params.poses()
        at = reversals(poses)
        return f" at ({poses[at[0], 0]:.2f}, {poses[at[0], 1]:.2f})" if at else None
    model = str(getattr(params, "motion_model_for_search", ""))
    return "" if "REEDS" in model.upper() else None


def _shortest_piece(params: Any) -> tuple[float, tuple[float, float]] | None:
    """Length (m) and end of the shortest piece between two changes of direction of a given path; None without one."""
    if not hasattr(params, "segments"):
        return None
    poses = params.poses()
    at = reversals(poses)
    steps = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    pieces = [(float(steps[a:b].sum()), (float(poses[b, 0]), float(poses[b, 1]))) for a, b in pairwise(at)]
    return min(pieces, default=None)
