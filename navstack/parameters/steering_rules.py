"""Checks of a base with a turning radius, a car, against controller, planner, path handler and recovery behaviors."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np

from navstack.core.parameter_checks import Issue
from navstack.core.path_turns import reversals
from navstack.parameters.configuration_types import Configuration
from navstack.parameters.models.sim import SimParams
from navstack.plugins import GLOBAL_PLANNERS

SAME_M = 1e-3
"""Difference of two radii that counts as none (m)."""


def steering_rules(configuration: Configuration) -> Iterator[Issue]:
    """Yield what a base with a turning radius cannot drive; nothing for a base that turns in place."""
    sim, local = configuration.navstack.sim, configuration.local_planner
    controller = float(getattr(local.params, "turning_radius", 0.0))
    radius = configuration.turning_radius
    if radius <= 0.0:
        return
    if sim.turning_radius > controller + SAME_M:
        yield _controller_too_tight(sim, local.name, local.namespace, local.params, controller)
    yield from _planner_too_tight(configuration, radius)
    yield from _recoveries_turn(configuration, radius)
    yield from _changes_of_direction(configuration)


def _controller_too_tight(sim: SimParams, name: str, namespace: str, params: Any, controller: float) -> Issue:
    """A controller that commands tighter curves than the base drives leaves the trajectories that it has checked."""
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
        f"{name} commands {what}, but the base (navstack/sim/kinematics {sim.kinematics}) turns on {sim.turning_radius:.3g} m at "
        f"least, so it leaves the trajectory that was checked; {fix}"
    )
    written = (*(f"/{namespace}/{n}" for n in names), "/base_local_planner", "/navstack/sim/kinematics")
    return Issue("warning", "turns-too-tight", written, message, need if controller > 0.0 else None)


def _planner_too_tight(configuration: Configuration, radius: float) -> Iterator[Issue]:
    """A path with corners, or with curves below the turning radius, cannot be held."""
    planner = configuration.global_planner
    params = planner.params
    own = getattr(params, "minimum_turning_radius", getattr(params, "turning_radius", 0.0))
    if float(own) >= radius - SAME_M:
        return
    if hasattr(params, "segments"):
        place, number, tightest = _tightest_segment(params)
        message = (
            f"segment {number} of {planner.name} turns on {tightest:.3g} m from ({place[0]:.2f}, {place[1]:.2f}) on, but the "
            f"base turns on {radius:.3g} m at least, so it leaves the path there; set its curvature to at most "
            f"{math.floor(100.0 / radius) / 100.0:g} 1/m"
        )
        yield Issue("warning", "planner-turning-radius", (f"/{planner.namespace}/segments",), message)
    elif hasattr(params, "minimum_turning_radius"):
        message = (
            f"minimum_turning_radius = {float(own):g} m of {planner.name} is under the turning radius of {radius:.3g} m of base "
            f"and controller, which cannot hold such a path; set it to {radius:.3g}"
        )
        names = (f"/{planner.namespace}/minimum_turning_radius",)
        yield Issue("warning", "planner-turning-radius", names, message, f"{radius:.3g}")
    else:
        known = [e.name for e in GLOBAL_PLANNERS if "minimum_turning_radius" in e.cls.Params.model_fields]
        others = " or ".join([*known, "given_path"])
        message = (
            f"{planner.name} plans paths with corners and without regard to the heading, so a base with a turning radius of "
            f"{radius:.3g} m leaves them; set base_global_planner to {others}"
        )
        yield Issue(
            "warning", "planner-turning-radius", ("/base_global_planner",), message, known[0] if known else None
        )


def _tightest_segment(params: Any) -> tuple[list[float], int, float]:
    """First pose, number and radius (m) of the tightest arc of a given path."""
    number = max(range(len(params.segments)), key=lambda k: abs(params.segments[k][1]))
    before = params.model_copy(update={"segments": params.segments[:number]})
    return before.poses()[-1].tolist(), number + 1, 1.0 / abs(params.segments[number][1])


def _recoveries_turn(configuration: Configuration, radius: float) -> Iterator[Issue]:
    """A recovery behavior that turns in place fails on such a base."""
    built_in = "recovery_behaviors" not in configuration.move_base.model_fields_set
    for recovery in configuration.recoveries:
        if not recovery.cls.turns_in_place:
            continue
        fix = "set clearing_rotation_allowed to false" if built_in else "remove it from recovery_behaviors"
        message = (
            f"{recovery.name} turns in place, which a base with a turning radius of {radius:.3g} m cannot, so it recovers "
            f"nothing; {fix}"
        )
        names = ("/clearing_rotation_allowed",) if built_in else ("/recovery_behaviors",)
        yield Issue("warning", "recovery-turns-in-place", (*names, "/navstack/sim/kinematics"), message)


def _changes_of_direction(configuration: Configuration) -> Iterator[Issue]:
    """A path that turns back overlaps itself under the footprint: it must be driven piece by piece, in both directions."""
    planner, local = configuration.global_planner, configuration.local_planner
    place = _first_reversal(planner.params)
    if place is None:
        return
    params: Any = local.params
    if not getattr(params, "drives_backward", True):
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
        yield Issue("warning", "cannot-reverse", (written, "/base_local_planner"), message)
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
        yield Issue("warning", "path-under-footprint", ("/PathHandler/enforce_path_inversion",), message, "true")
        return
    short = _shortest_piece(planner.params)
    if short is not None and short[0] <= cuts.inversion_xy_tolerance:
        length, (x, y) = short
        message = (
            f"the piece of {length:.2f} m between two changes of direction at ({x:.2f}, {y:.2f}) is no longer than "
            f"inversion_xy_tolerance = {cuts.inversion_xy_tolerance:g} m, so it counts as driven when it begins; set the "
            f"tolerance to {0.5 * length:.2g}, or lengthen the piece"
        )
        yield Issue("warning", "path-under-footprint", ("/PathHandler/inversion_xy_tolerance",), message)


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
