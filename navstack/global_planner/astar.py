"""astar: the exact cheapest path over the 8 neighbors of each cell (P. Hart, N. Nilsson, B. Raphael, 1968)."""

from __future__ import annotations

from navstack.global_planner._search.cell_search import CellPlanner, CellPlannerParams, octile_expansion
from navstack.plugins import GLOBAL_PLANNERS


class AStarParams(CellPlannerParams):
    """Parameters of astar."""


@GLOBAL_PLANNERS.register("astar")
class AStarPlanner(CellPlanner):
    """astar: the cheapest path over the 8 neighbors, exact up to rounding (heuristic: octile distance).

    navfn's potential only approximates this path. Ties between cheapest paths go to the first one found: cells whose f
    differs by less than half of `neutral_cost` are expanded last in, first out; neighbors are visited in the order E W N S
    NE NW SE SW; a cell keeps its predecessor unless another one is cheaper. With `heuristic_weight` w > 1 the cost is at
    most w times the optimum.
    """

    Params = AStarParams

    def __init__(self, params: AStarParams | None = None) -> None:
        super().__init__(params or AStarParams(), octile_expansion)
