"""theta_star: any-angle paths (A. Nash, K. Daniel, S. Koenig, A. Felner, 2007)."""

from __future__ import annotations

from typing import cast

from navstack.core import Costmap
from navstack.global_planner.cell_planner import CellPlanner, CellPlannerParams, Found
from navstack.global_planner.cell_search import CellSearch, Weights
from navstack.global_planner.ends import Cell
from navstack.plugins import GLOBAL_PLANNERS


class ThetaStarParams(CellPlannerParams):
    """Parameters of theta_star."""


@GLOBAL_PLANNERS.register("theta_star")
class ThetaStarPlanner(CellPlanner):
    """theta_star: straight lines between cell centres, at any angle, where they are cheaper than steps from cell to cell.

    A line is legal when no cell it touches is blocked (lethal, inscribed), and costs, as astar's steps do, in every cell the
    length in it times that cell's weight. Theta* alone is no exact method: astar's path is pulled tight as well, and the
    cheaper of the two is the plan. So it never costs more than astar's, and with `cost_factor` 0 is never longer.
    """

    Params = ThetaStarParams

    def __init__(self, params: ThetaStarParams | None = None) -> None:
        super().__init__(params or ThetaStarParams())
        self._steps = CellSearch()

    def _find(self, costmap: Costmap, weights: Weights, start: Cell, goal: Cell) -> Found | None:
        params = cast("ThetaStarParams", self.params)
        search, cut, heuristic = self._search, params.cut_corners, params.heuristic_weight
        if not search.any_angle(costmap, weights, start, goal, heuristic=heuristic, cut_corners=cut):
            return None
        corners, cost = search.pulled_tight(costmap, weights, search.corners(start, goal), cut_corners=cut)
        steps = self._steps
        steps.octile(costmap, weights, start, goal, heuristic=heuristic, cut_corners=cut)
        others, other_cost = steps.pulled_tight(costmap, weights, steps.path(start, goal), cut_corners=cut)
        if other_cost < cost:
            corners, cost = others, other_cost
        a, b = search.rectangle, steps.rectangle
        rectangle = (min(a[0], b[0]), min(a[1], b[1]), max(a[2], b[2]), max(a[3], b[3]))
        return Found(corners, cost, search.expanded + steps.expanded, rectangle)
