"""Why there is no plan for a robot with a shape and a turning radius."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import (
    UNKNOWN,
    Costmap,
    Footprint,
    GoalOccupiedError,
    NoValidPathError,
    PlanningError,
    PlanningTimeoutError,
    Pose2D,
    describe_cost,
)
from navstack.global_planner._se2 import search as kernels
from navstack.global_planner._se2.engine import PoseSearch
from navstack.global_planner._se2.params import PosePlannerParams
from navstack.global_planner._se2.search import Outcome
from navstack.global_planner._search import planning_errors
from navstack.global_planner._search.best_first import BestFirst
from navstack.global_planner._search.cells import CellCosts, SearchSpace, cell_coordinates, cell_costs
from navstack.global_planner._search.planning_errors import Gap, gaps, narrowest

_MAX_EXPANDED: Final = 4_000_000
_AHEAD: Final = 6
"""Cells: distance over which the direction of a path of cells is taken."""
_TURN: Final = math.radians(15.0)
"""Deviation from the direction of a path at which the footprint is tried, too."""
_STEP: Final = math.radians(10.0)
"""Step of the headings that are tried at a blocked goal."""
_TURNS: Final = np.radians([0.0, 5.0, -5.0, 10.0, -10.0, 15.0, -15.0])
"""Deviations from the direction of a gap at which the footprint is tried."""


def _costs(allow_unknown: bool) -> CellCosts:
    return cell_costs(allow_unknown, 50.0, 0.8)


def _space(grid: Costmap, allow_unknown: bool) -> SearchSpace:
    return SearchSpace(grid, _costs(allow_unknown), border_blocked=False)


def _cell(grid: Costmap, pose: Pose2D) -> tuple[int, int]:
    cell = grid.geometry.world_to_cell(pose.x, pose.y)
    assert cell is not None
    return cell


def goal_occupied(
    engine: PoseSearch, grid: Costmap, goal: Pose2D, footprint: Footprint | None, tolerance: float
) -> GoalOccupiedError:
    """The error for a goal where the robot does not fit, nor within the tolerance (m); says which cell is in its way."""
    ix, iy = _cell(grid, goal)
    cost = int(grid.data[iy, ix])
    within = f", nor within tolerance {tolerance} m of it" if tolerance > 0.0 else ""
    occupied = planning_errors.occupied_data(_space(grid, True), (ix, iy))
    data: dict[str, Any] = {**occupied, "x": goal.x, "y": goal.y, "yaw": goal.yaw}
    blocking = _blocking_cell(grid, goal, footprint)
    if cost == 254 or blocking is None:
        why = (
            "the map is unknown there" if cost == UNKNOWN else f"its center is in a cell of cost {describe_cost(cost)}"
        )
    else:
        x, y = grid.geometry.cell_to_world(*blocking)
        data["blocked_by"] = [x, y]
        why = f"its footprint overlaps the obstacle at ({x:.2f}, {y:.2f})"
    headings = _free_headings(engine, grid, goal)
    data["free_headings"] = headings
    if headings:
        hint = f"it fits there at other headings: {_ranges_text(headings)}"
    elif cost == UNKNOWN:
        hint = "choose a goal in known space, or set allow_unknown: true"
    else:
        hint = "it fits there at no heading; choose a goal further from obstacles"
    return GoalOccupiedError(
        f"the robot does not fit at the goal ({goal.x:.3f}, {goal.y:.3f}) with heading {goal.yaw:.3f}{within}: {why}; {hint}",
        **data,
    )


def _free_headings(engine: PoseSearch, grid: Costmap, goal: Pose2D) -> list[float]:
    """Headings (rad) at which the robot fits at the goal, the nearest to the requested one first."""
    x, y = cell_coordinates(grid.geometry, goal)
    found = [math.remainder(goal.yaw + sign * k * _STEP, 2.0 * math.pi) for k in range(1, 19) for sign in (1.0, -1.0)]
    return [yaw for yaw in found if engine.pose_is_free(x, y, yaw)]


def _ranges_text(headings: list[float]) -> str:
    """Headings in steps of 10 degrees as ranges, the one with the first of them first."""
    left, ranges = set(headings), list[str]()
    for heading in headings:
        if heading not in left:
            continue
        ends = [heading, heading]
        left.discard(heading)
        for k, sign in ((0, -1.0), (1, 1.0)):
            while near := [h for h in left if abs(math.remainder(h - ends[k] - sign * _STEP, 2.0 * math.pi)) < 1e-6]:
                ends[k] = near[0]
                left.discard(near[0])
        low, high = (f"{end:.2f}" for end in ends)
        ranges.append(f"{low} to {high} rad" if low != high else f"{low} rad")
    return ", ".join(ranges)


def _blocking_cell(grid: Costmap, pose: Pose2D, footprint: Footprint | None) -> tuple[int, int] | None:
    """The lethal cell under a footprint that is nearest to its center."""
    import shapely

    if footprint is None:
        return None
    g = grid.geometry
    polygon = shapely.Polygon(footprint.at(pose))
    left, low, right, high = polygon.bounds
    x0, y0 = g.world_to_cell_unbounded(left, low)
    x1, y1 = g.world_to_cell_unbounded(right, high)
    best, nearest = None, math.inf
    for iy in range(max(0, y0), min(g.ny, y1 + 1)):
        for ix in range(max(0, x0), min(g.nx, x1 + 1)):
            if grid.data[iy, ix] == 254:
                x, y = g.cell_to_world(ix, iy)
                half = 0.5 * g.resolution
                distance = math.hypot(x - pose.x, y - pose.y)
                if distance < nearest and polygon.intersects(shapely.box(x - half, y - half, x + half, y + half)):
                    best, nearest = (ix, iy), distance
    return best


def no_connection(grid: Costmap, start: Pose2D, goal: Pose2D, allow_unknown: bool) -> PlanningError:
    """The error for a goal that not even the center of the robot can reach."""
    space = _space(grid, allow_unknown)
    cells = _cell(grid, start), _cell(grid, goal)
    search = BestFirst(_costs(allow_unknown))
    search.octile(grid, *cells, max_expanded=_MAX_EXPANDED)
    nearest = search.nearest_reached(cells[1])
    return planning_errors.no_path(space, start, goal, cells, nearest, expanded=search.expanded)


def no_path(
    engine: PoseSearch,
    grid: Costmap,
    ends: tuple[Pose2D, Pose2D, Pose2D | None],
    outcome: Outcome,
    params: PosePlannerParams,
) -> PlanningError:
    """The error for a search that found no path: where the passage is too narrow, or where there is no room to turn.

    `ends`: start, goal, and the pose within the tolerance that was searched for instead of the goal.
    """
    g = grid.geometry
    start, goal, moved_to = ends
    near = (outcome.nearest[0] * g.resolution + g.origin_x, outcome.nearest[1] * g.resolution + g.origin_y)
    distance = math.hypot(near[0] - goal.x, near[1] - goal.y)
    narrow = narrow_stretches(engine, grid, start, moved_to or goal, params.allow_unknown)
    if narrow is None:  # the heuristic, with larger cells, saw a way
        return no_connection(grid, start, goal, params.allow_unknown)
    data: dict[str, Any] = {
        "nearest_reachable": list(near),
        "nearest_reachable_distance_m": distance,
        "states_expanded": outcome.expanded,
        "states_visited": outcome.visited,
        "narrow": narrow,
    }
    where = f"the nearest state reached is at ({near[0]:.2f}, {near[1]:.2f}), {distance:.2f} m from the goal"
    way = f"from ({start.x:.3f}, {start.y:.3f}) to ({goal.x:.3f}, {goal.y:.3f})"
    if moved_to is not None:
        way += f", nor to ({moved_to.x:.3f}, {moved_to.y:.3f}) within the tolerance,"
    if outcome.status == kernels.LIMIT:
        limit = f"max_iterations = {params.max_iterations}"
        if outcome.timed_out:
            limit = f"max_planning_time = {params.max_planning_time} s"
        return PlanningTimeoutError(
            f"no path {way} found within {limit}, after {outcome.expanded:,} states; {where}{_narrow_text(narrow)}; "
            + (
                "another way needs a higher limit"
                if narrow
                else "increase the limit or the tolerance, or allow reversing"
            ),
            **data,
        )
    text = _narrow_text(narrow)
    if outcome.enclosed is not None:
        data["enclosed_within_m"] = outcome.enclosed * g.resolution
        text += (
            f"; no way leads to the goal: backward from it, at heading {goal.yaw:.2f} rad, the robot gets at most "
            f"{outcome.enclosed * g.resolution:.2f} m away; choose another heading, a goal farther from obstacles, or a "
            "larger tolerance"
        )
    elif outcome.impossible:
        text = text or "; every way is too narrow for the footprint somewhere"
    elif not text:
        x, y, yaw = engine.furthest(g.resolution, g.origin_x, g.origin_y)
        data["furthest"] = [x, y, yaw]
        text = (
            f"; the way is wide enough for the footprint, but not for the turns: from ({x:.2f}, {y:.2f}) with heading "
            f"{yaw:.2f} rad it cannot go on; the turning radius is too large there, or the goal can be reached at another "
            "heading only" + ("" if engine.settings["reeds_shepp"][0] else "; reversing may help")
        )
    return NoValidPathError(f"no path {way} for this footprint and turning radius; {where}{text}", **data)


def _narrow_text(narrow: list[dict[str, Any]]) -> str:
    if not narrow:
        return ""
    spots = [
        f"({s['x']:.2f}, {s['y']:.2f}) at heading {s['heading']:.2f} rad ({s['width_m']:.2f} m wide, over {s['length_m']:.2f} m)"
        for s in narrow[:3]
    ]
    return f"; the shortest way is too narrow for the footprint at {', then at '.join(spots)}"


def narrow_stretches(
    engine: PoseSearch, grid: Costmap, start: Pose2D, goal: Pose2D, allow_unknown: bool
) -> list[dict[str, Any]] | None:
    """The narrowest gaps of the stretches of the cheapest path of cells where the footprint does not fit.

    `x`, `y` is the middle of the gap, `heading` the direction through it, `width_m` its width, `length_m` the length of the
    stretch. None if no cells connect start and goal.
    """
    search = BestFirst(_costs(allow_unknown))
    cells = _cell(grid, start), _cell(grid, goal)
    if not search.octile(grid, *cells, max_expanded=_MAX_EXPANDED):
        return [] if search.expanded >= _MAX_EXPANDED else None
    route = search.path(*cells)
    backward = (math.pi,) if engine.settings["reeds_shepp"][0] else ()
    return min((_narrow_along(engine, grid, route, turned) for turned in (0.0, *backward)), key=len)


def _narrow_along(engine: PoseSearch, grid: Costmap, route: NDArray[np.int64], turned: float) -> list[dict[str, Any]]:
    """The stretches of a route (n, 2) where the footprint does not fit, `turned` from the direction of the route (rad)."""
    tight = [i for i in range(1, len(route) - 1) if not _fits_along(engine, route, i, turned)]
    # without a gap there, in one as wide as the robot is long, or next to the path in the gap, the robot has room
    longest = 2.0 * engine.shape.reach * grid.geometry.resolution
    found_gaps = zip(tight, gaps(grid, route[tight]), strict=True)
    between = {i: gap for i, gap in found_gaps if gap is not None and gap.width_m < longest}
    narrow = {i: gap for i, gap in between.items() if not _fits_beside(engine, grid, route[i], gap, turned)}
    if not narrow:
        return []
    # places closer than the robot is long are one
    along = np.append(0.0, np.cumsum(np.hypot(*np.diff(route, axis=0).T)))
    indices = np.array(list(narrow))
    found: list[dict[str, Any]] = []
    for which in np.split(indices, np.flatnonzero(np.diff(along[indices]) > 2.0 * engine.shape.reach) + 1):
        gap = narrowest(narrow[i] for i in which.tolist())
        assert gap is not None
        length = float(along[which[-1] + 1] - along[which[0]]) * grid.geometry.resolution
        found.append({"x": gap.x, "y": gap.y, "heading": gap.heading, "width_m": gap.width_m, "length_m": length})
    return found


def _fits_along(engine: PoseSearch, route: NDArray[np.int64], i: int, turned: float) -> bool:
    """Whether the footprint fits at a cell of a route, at a heading near that of the route."""
    ahead = route[min(len(route) - 1, i + _AHEAD)] - route[max(0, i - _AHEAD)]
    heading = math.atan2(ahead[1], ahead[0]) + turned
    x, y = route[i] + 0.5
    return any(engine.pose_is_free(x, y, heading + turn) for turn in (0.0, _TURN, -_TURN))


def _fits_beside(engine: PoseSearch, grid: Costmap, cell: NDArray[np.int64], gap: Gap, turned: float) -> bool:
    """Whether the footprint fits somewhere next to a cell of a route, at a heading near that of its gap."""
    x, y = cell + 0.5
    half = 0.5 * gap.width_m / grid.geometry.resolution
    aside = np.linspace(-half, half, max(3, 2 * math.ceil(2.0 * half) + 1))
    return any(
        engine.pose_is_free(x - s * math.sin(gap.heading), y + s * math.cos(gap.heading), gap.heading + turned + turn)
        for turn in _TURNS
        for s in aside[np.argsort(np.abs(aside), kind="stable")]
    )
