"""The errors of a planner that found no path, with the data that explains them."""

from __future__ import annotations

import math
from typing import Any

from navstack.core import Costmap, Pose2D, describe_cost
from navstack.core.errors import GoalOccupiedError, NoValidPathError, PlanningTimeoutError, StartOccupiedError
from navstack.global_planner._search.blockage import blocked_stretches
from navstack.global_planner._search.cells import Cell
from navstack.global_planner._search.search_space import SearchSpace


def occupied_data(space: SearchSpace, cell: Cell) -> dict[str, Any]:
    """The data of an error about an occupied cell: the cell, its cost, and the nearest free cell."""
    costmap = space.costmap
    x, y = costmap.geometry.cell_to_world(*cell)
    data: dict[str, Any] = {"cell": list(cell), "cost": int(costmap.data[cell[1], cell[0]]), "x": x, "y": y}
    free = space.nearest_free(cell)
    if free is not None:
        data["nearest_free"] = list(costmap.geometry.cell_to_world(*free[0]))
        data["nearest_free_distance_m"] = free[1]
    return data


def _location(space: SearchSpace, cell: Cell) -> str:
    if not space.is_obstacle(cell):
        return "on the border of the map, which this planner treats as blocked"
    cost = int(space.costmap.data[cell[1], cell[0]])
    unknown = ", and allow_unknown is false" if cost == 255 and not space.costs.allow_unknown else ""
    return f"in a cell of cost {describe_cost(cost)}{unknown}"


def _nearest_free(data: dict[str, Any]) -> str:
    if "nearest_free" not in data:
        return "the map has no free cell"
    x, y = data["nearest_free"]
    return f"the nearest free cell is {data['nearest_free_distance_m']:.2f} m away at ({x:.2f}, {y:.2f})"


def goal_occupied(space: SearchSpace, goal: Pose2D, cell: Cell, tolerance: float) -> GoalOccupiedError:
    """The error for a goal that is blocked, as are all cells within the tolerance (m)."""
    data = occupied_data(space, cell)
    within = f", as is every cell within default_tolerance {tolerance} m" if tolerance > 0.0 else ""
    return GoalOccupiedError(
        f"the goal ({goal.x:.3f}, {goal.y:.3f}) is {_location(space, cell)}{within}; {_nearest_free(data)}",
        **{**data, "x": goal.x, "y": goal.y},
    )


def start_occupied(
    space: SearchSpace, start: Pose2D, cell: Cell, *, because: str = "with no free cell beside it"
) -> StartOccupiedError:
    """The error for a start in a blocked cell that no path can leave."""
    data = occupied_data(space, cell)
    return StartOccupiedError(
        f"the start ({start.x:.3f}, {start.y:.3f}) is {_location(space, cell)}, {because}; {_nearest_free(data)}",
        **{**data, "x": start.x, "y": start.y},
    )


def timeout(
    costmap: Costmap,
    start: Pose2D,
    goal: Pose2D,
    nearest: Cell,
    *,
    expanded: int,
    max_expansions: int,
    name: str = "max_expansions",
) -> PlanningTimeoutError:
    """The error for a search that ended because of its limit, the parameter `name`; `nearest`: the reached cell nearest to the
    goal.
    """
    x, y = costmap.geometry.cell_to_world(*nearest)
    distance = math.hypot(x - goal.x, y - goal.y)
    return PlanningTimeoutError(
        f"no path from ({start.x:.3f}, {start.y:.3f}) to ({goal.x:.3f}, {goal.y:.3f}) found within {name} = "
        f"{max_expansions} cells; the nearest point reached is ({x:.2f}, {y:.2f}), {distance:.2f} m from the goal; increase "
        f"{name}, or set it to 0 for no limit",
        nearest_reachable=[x, y],
        nearest_reachable_distance_m=distance,
        cells_expanded=expanded,
        max_expansions=max_expansions,
    )


def no_path(
    space: SearchSpace, start: Pose2D, goal: Pose2D, cells: tuple[Cell, Cell], nearest: Cell, *, expanded: int
) -> NoValidPathError:
    """The error for a goal that cannot be reached; `nearest`: the reachable cell nearest to it.

    `cells`: those of start and goal. `data["blocked_by"]` lists the blocked stretches of the least blocked route from start
    to goal, in order (see `blockage.blocked_stretches`).
    """
    x, y = space.costmap.geometry.cell_to_world(*nearest)
    distance = math.hypot(x - goal.x, y - goal.y)
    stretches = blocked_stretches(space.costmap, space.costs, *cells)
    blockage = f"; the route is blocked by {', then by '.join(s.text for s in stretches[:3])}" if stretches else ""
    return NoValidPathError(
        f"no path connects the start ({start.x:.3f}, {start.y:.3f}) and the goal ({goal.x:.3f}, {goal.y:.3f}); "
        f"the reachable point nearest to the goal is ({x:.2f}, {y:.2f}), {distance:.2f} m from it{blockage}",
        nearest_reachable=[x, y],
        nearest_reachable_distance_m=distance,
        cells_expanded=expanded,
        blocked_by=[s.as_dict() for s in stretches],
    )
