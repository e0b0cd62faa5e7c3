"""Where a plan starts and ends: checks, errors that explain, and the search for another goal."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from navstack.core import Costmap, Pose2D, describe_cost, normalize_angle
from navstack.core.errors import (
    GoalOccupiedError,
    GoalOutsideMapError,
    InputError,
    NoValidPathError,
    PlanningTimeoutError,
    StartOccupiedError,
    StartOutsideMapError,
)
from navstack.global_planner.cost_rule import CostRule
from navstack.global_planner.seal import blocked_stretches

Cell = tuple[int, int]


def with_yaw_in_range(pose: Pose2D) -> Pose2D:
    """The pose with its yaw in (-pi, pi]: the very same where it lies there already, or is no number."""
    if -math.pi < pose.yaw <= math.pi or not math.isfinite(pose.yaw):
        return pose
    return pose._replace(yaw=normalize_angle(pose.yaw))


def cells_of(costmap: Costmap, start: Pose2D, goal: Pose2D) -> tuple[Cell, Cell]:
    """The cells that hold start and goal; raises InputError, StartOutsideMapError or GoalOutsideMapError."""
    for what, pose in (("start", start), ("goal", goal)):
        if not pose.is_finite():
            raise InputError(f"the {what} {_pose(pose)} is not a finite pose: give x, y (m) and yaw (rad)", pose=pose)
    g = costmap.geometry
    left, right, bottom, top = g.extent
    found: list[Cell] = []
    for what, pose, error in (("start", start, StartOutsideMapError), ("goal", goal, GoalOutsideMapError)):
        cell = g.world_to_cell(pose.x, pose.y)
        if cell is None:
            raise error(
                f"the {what} ({pose.x:.3f}, {pose.y:.3f}) lies outside the costmap, which covers x {left:.3f} .. {right:.3f}, "
                f"y {bottom:.3f} .. {top:.3f} m in frame {costmap.frame}",
                x=pose.x,
                y=pose.y,
                extent=[left, right, bottom, top],
            )
        found.append(cell)
    return found[0], found[1]


def _pose(pose: Pose2D) -> str:
    return f"({pose.x}, {pose.y}, {pose.yaw})"


def is_blocked(costmap: Costmap, rule: CostRule, cell: Cell, *, ring: bool = True) -> bool:
    """True for a cell the rule does not let a path enter; with `ring`, the outermost cells too."""
    ix, iy = cell
    g = costmap.geometry
    on_ring = ix in (0, g.nx - 1) or iy in (0, g.ny - 1)
    return (ring and on_ring) or bool(rule.blocked[costmap.data[iy, ix]])


def nearest_free(costmap: Costmap, rule: CostRule, cell: Cell, *, ring: bool = True) -> tuple[Cell, float] | None:
    """The free cell whose centre is nearest to that of `cell`, and the distance in metres; None when there is none."""
    ix, iy = cell
    edge = 1 if ring else 0
    nx, ny = costmap.geometry.nx, costmap.geometry.ny
    reach = 8
    while True:
        x0, x1 = max(edge, ix - reach), min(nx - edge, ix + reach + 1)
        y0, y1 = max(edge, iy - reach), min(ny - edge, iy + reach + 1)
        if x0 < x1 and y0 < y1:
            ys, xs = np.nonzero(~rule.blocked[costmap.data[y0:y1, x0:x1]])
            if len(xs):
                squared = (xs + (x0 - ix)) ** 2 + (ys + (y0 - iy)) ** 2
                best = int(np.argmin(squared))
                # a cell outside the square may be nearer than one in its corner
                if squared[best] <= reach * reach or reach >= max(nx, ny):
                    found = int(xs[best]) + x0, int(ys[best]) + y0
                    return found, math.sqrt(int(squared[best])) * costmap.geometry.resolution
        if reach >= max(nx, ny):
            return None
        reach *= 2


def occupied_data(costmap: Costmap, rule: CostRule, cell: Cell, *, ring: bool = True) -> dict[str, Any]:
    """What an error about an occupied cell carries: cell, cost, and the nearest free cell."""
    x, y = costmap.geometry.cell_to_world(*cell)
    data: dict[str, Any] = {"cell": list(cell), "cost": int(costmap.data[cell[1], cell[0]]), "x": x, "y": y}
    free = nearest_free(costmap, rule, cell, ring=ring)
    if free is not None:
        data["nearest_free"] = list(costmap.geometry.cell_to_world(*free[0]))
        data["nearest_free_distance_m"] = free[1]
    return data


def _why(costmap: Costmap, rule: CostRule, cell: Cell) -> str:
    cost = int(costmap.data[cell[1], cell[0]])
    if not rule.blocked[cost]:
        return "on the map's outermost ring of cells, which this planner keeps blocked"
    return f"in a cell of cost {describe_cost(cost)}" + (
        ", and allow_unknown is false" if cost == 255 and not rule.allow_unknown else ""
    )


def _way_out(data: dict[str, Any]) -> str:
    if "nearest_free" not in data:
        return "the map has no free cell"
    x, y = data["nearest_free"]
    return f"the nearest free cell is {data['nearest_free_distance_m']:.2f} m away at ({x:.2f}, {y:.2f})"


def goal_occupied(
    costmap: Costmap, rule: CostRule, goal: Pose2D, cell: Cell, tolerance: float, *, ring: bool = True
) -> GoalOccupiedError:
    """The error for a goal that no path may enter, nor any cell within the tolerance."""
    data = occupied_data(costmap, rule, cell, ring=ring)
    within = f", and so is everything within default_tolerance {tolerance} m" if tolerance > 0.0 else ""
    return GoalOccupiedError(
        f"the goal ({goal.x:.3f}, {goal.y:.3f}) lies {_why(costmap, rule, cell)}{within}; {_way_out(data)}",
        **{**data, "x": goal.x, "y": goal.y},
    )


def start_occupied(
    costmap: Costmap,
    rule: CostRule,
    start: Pose2D,
    cell: Cell,
    *,
    ring: bool = True,
    because: str = "with no free cell beside it",
) -> StartOccupiedError:
    """The error for a start in a blocked cell that a path cannot leave, `because` of what."""
    data = occupied_data(costmap, rule, cell, ring=ring)
    return StartOccupiedError(
        f"the start ({start.x:.3f}, {start.y:.3f}) lies {_why(costmap, rule, cell)}, {because}; {_way_out(data)}",
        **{**data, "x": start.x, "y": start.y},
    )


def timeout(
    costmap: Costmap, start: Pose2D, goal: Pose2D, nearest: Cell, expanded: int, most: int
) -> PlanningTimeoutError:
    """The error for a search that was to end after `most` cells, with the point it had come nearest to the goal."""
    x, y = costmap.geometry.cell_to_world(*nearest)
    distance = math.hypot(x - goal.x, y - goal.y)
    return PlanningTimeoutError(
        f"no path from ({start.x:.3f}, {start.y:.3f}) to ({goal.x:.3f}, {goal.y:.3f}) within the {most} cells that "
        f"max_expansions allows; the search came as near as ({x:.2f}, {y:.2f}), {distance:.2f} m from the goal; raise "
        "max_expansions, or set it to 0 for a search that goes on to the end",
        nearest_reachable=[x, y],
        nearest_reachable_distance_m=distance,
        cells_expanded=expanded,
        max_expansions=most,
    )


def no_path(
    costmap: Costmap,
    rule: CostRule,
    start: Pose2D,
    goal: Pose2D,
    cells: tuple[Cell, Cell],
    nearest: Cell,
    expanded: int,
) -> NoValidPathError:
    """The error for a goal that the search from the start did not reach, with the point it reached nearest to it.

    `cells`: those of start and goal. `data["sealed_by"]` lists the blocked stretches that the least blocked way from start
    to goal crosses, in order (see `seal.blocked_stretches`).
    """
    g = costmap.geometry
    x, y = g.cell_to_world(*nearest)
    distance = math.hypot(x - goal.x, y - goal.y)
    stretches = blocked_stretches(costmap, rule, *cells)
    seal = f"; what seals it off: {'; then '.join(s.text for s in stretches[:3])}" if stretches else ""
    return NoValidPathError(
        f"no path connects the start ({start.x:.3f}, {start.y:.3f}) and the goal ({goal.x:.3f}, {goal.y:.3f}); "
        f"the reachable point nearest to the goal is ({x:.2f}, {y:.2f}), {distance:.2f} m from it{seal}",
        nearest_reachable=[x, y],
        nearest_reachable_distance_m=distance,
        cells_expanded=expanded,
        sealed_by=[s.as_dict() for s in stretches],
    )


def goal_candidates(costmap: Costmap, goal: Pose2D, tolerance: float) -> list[tuple[Pose2D, Cell]]:
    """Where the plan may end, nearest first: the goal, or with a tolerance (m) a lattice in the square around it.

    The lattice begins at goal - tolerance and has the costmap's resolution, as NavfnROS::makePlan's.
    """
    g = costmap.geometry
    if tolerance <= 0.0:
        cell = g.world_to_cell(goal.x, goal.y)
        return [] if cell is None else [(goal, cell)]
    found: list[tuple[float, Pose2D, Cell]] = []
    y = goal.y - tolerance
    while y <= goal.y + tolerance:
        x = goal.x - tolerance
        while x <= goal.x + tolerance:
            cell = g.world_to_cell(x, y)
            if cell is not None:
                found.append(((x - goal.x) ** 2 + (y - goal.y) ** 2, Pose2D(x, y, goal.yaw), cell))
            x += g.resolution
        y += g.resolution
    found.sort(key=lambda c: c[0])  # stable: the first in reading order on a tie
    own = g.world_to_cell(goal.x, goal.y)
    if own is not None:  # the goal itself, which rounding may have moved by a hair
        found.insert(0, (0.0, goal, own))
    return [(pose, cell) for _, pose, cell in found]
