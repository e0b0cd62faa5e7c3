"""astar: the exact cheapest path over the 8 neighbours of each cell (P. Hart, N. Nilsson, B. Raphael, 1968)."""

from __future__ import annotations

from typing import cast

from navstack.core import Costmap
from navstack.global_planner.cell_planner import CellPlanner, CellPlannerParams, Found
from navstack.global_planner.cell_search import Weights
from navstack.global_planner.ends import Cell
from navstack.plugins import GLOBAL_PLANNERS


class AStarParams(CellPlannerParams):
    """Parameters of astar."""


@GLOBAL_PLANNERS.register("astar")
class AStarPlanner(CellPlanner):
    """astar: the path of least cost over the 8 neighbours, exact up to rounding (heuristic: octile distance).

    What navfn's potential only comes near to. Of several cheapest paths it takes, always, the one found first: cells of the
    same half `neutral_cost` of f are visited last in, first out; neighbours in the order E W N S NE NW SE SW; a cell keeps
    its predecessor unless another is cheaper. With `heuristic_weight` w > 1 the cost is at most w times the least.
    """

    Params = AStarParams

    def __init__(self, params: AStarParams | None = None) -> None:
        super().__init__(params or AStarParams())

    def _find(self, costmap: Costmap, weights: Weights, start: Cell, goal: Cell, most: int) -> Found | None:
        params = cast("AStarParams", self.params)
        search = self._search
        if not search.octile(
            costmap,
            weights,
            start,
            goal,
            heuristic=params.heuristic_weight,
            cut_corners=params.cut_corners,
            most=most,
        ):
            return None
        return Found(search.path(start, goal), search.cost_of(goal), search.expanded, search.rectangle)
