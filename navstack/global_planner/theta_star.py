"""theta_star: any-angle paths (A. Nash, K. Daniel, S. Koenig, A. Felner, 2007)."""

from __future__ import annotations

from navstack.global_planner._search.base import Query
from navstack.global_planner._search.best_first import BestFirst
from navstack.global_planner._search.cell_search import CellPath, CellPlanner, CellPlannerParams
from navstack.global_planner._search.cells import Cell, union
from navstack.plugins import GLOBAL_PLANNERS


class ThetaStarParams(CellPlannerParams):
    """Parameters of theta_star."""


@GLOBAL_PLANNERS.register("theta_star")
class ThetaStarPlanner(CellPlanner):
    """theta_star: straight lines between cell centers, at any angle, where they are cheaper than steps from cell to cell.

    A line is legal if no cell it touches is blocked (lethal, inscribed). As for the steps of astar, its cost in each cell is
    the length in it times the weight of the cell. Theta* alone is not exact: the path of astar is pulled tight first, and
    replaced by that of Theta* if the latter is cheaper. The result therefore never costs more than the path of astar, and
    with `cost_factor` 0 it is never longer. Cells from which the rest of astar's path, less 8 %, is already too expensive are
    left out: no straight line is shorter than that.
    """

    Params = ThetaStarParams

    def __init__(self, params: ThetaStarParams | None = None) -> None:
        super().__init__(params or ThetaStarParams(), _expand)


def _expand(search: BestFirst, query: Query, goal: Cell, max_expanded: int) -> CellPath | None:
    costmap, start = query.space.costmap, query.start_cell
    # from the goal, because the costs to the goal help the second search; a blocked start cannot be entered, only left
    from_goal = not query.space.is_blocked(start) and search.octile(costmap, goal, start, max_expanded=max_expanded)
    if from_goal:
        path = search.path(goal, start)[::-1]
    elif search.octile(costmap, start, goal, max_expanded=max_expanded):
        path = search.path(start, goal)
    else:
        return None
    search.prepare_lines(costmap, from_goal=from_goal)
    corners, cost = search.pull_tight(costmap, path)
    window, expanded = search.window, search.expanded
    remaining = max(0, max_expanded - expanded)
    if search.any_angle(costmap, start, goal, max_expanded=remaining, upper_bound=cost):
        others, other_cost = search.pull_tight(costmap, search.corners(start, goal))
        if other_cost < cost:
            corners, cost = others, other_cost
    return CellPath(corners, cost, expanded + search.expanded, union(window, search.window))
