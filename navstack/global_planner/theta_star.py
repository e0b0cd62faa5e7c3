"""theta_star: any-angle paths (A. Nash, K. Daniel, S. Koenig, A. Felner, 2007)."""

from __future__ import annotations

from typing import cast

from navstack.core import Costmap
from navstack.global_planner.cell_planner import CellPlanner, CellPlannerParams, Found
from navstack.global_planner.cell_search import Weights, union
from navstack.global_planner.ends import Cell
from navstack.plugins import GLOBAL_PLANNERS


class ThetaStarParams(CellPlannerParams):
    """Parameters of theta_star."""


@GLOBAL_PLANNERS.register("theta_star")
class ThetaStarPlanner(CellPlanner):
    """theta_star: straight lines between cell centres, at any angle, where they are cheaper than steps from cell to cell.

    A line is legal when no cell it touches is blocked (lethal, inscribed), and costs, as astar's steps do, in every cell the
    length in it times that cell's weight. Theta* alone is no exact method: astar's path is pulled tight first, and Theta* is
    asked for a cheaper one. So it never costs more than astar's, and with `cost_factor` 0 is never longer.
    """

    Params = ThetaStarParams

    def __init__(self, params: ThetaStarParams | None = None) -> None:
        super().__init__(params or ThetaStarParams())

    def _find(self, costmap: Costmap, weights: Weights, start: Cell, goal: Cell, most: int) -> Found | None:
        params = cast("ThetaStarParams", self.params)
        search, cut, heuristic = self._search, params.cut_corners, params.heuristic_weight
        if not search.octile(costmap, weights, start, goal, heuristic=heuristic, cut_corners=cut, most=most):
            return None
        corners, cost = search.pulled_tight(costmap, weights, search.path(start, goal), cut_corners=cut)
        looked_at, expanded = search.rectangle, search.expanded
        if search.any_angle(
            costmap,
            weights,
            start,
            goal,
            heuristic=heuristic,
            cut_corners=cut,
            most=max(0, most - expanded),
            below=cost,
        ):
            others, other_cost = search.pulled_tight(costmap, weights, search.corners(start, goal), cut_corners=cut)
            if other_cost < cost:
                corners, cost = others, other_cost
        return Found(corners, cost, expanded + search.expanded, union(looked_at, search.rectangle))
