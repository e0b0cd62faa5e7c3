"""Planners whose path runs straight from cell center to cell center (astar, theta_star)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import Pose2D, Window
from navstack.global_planner._search.base import Query, Route, Search, SearchParams, SearchPlanner, Unreachable
from navstack.global_planner._search.best_first import UNLIMITED, BestFirst
from navstack.global_planner._search.cells import Cell, CellCosts, cell_costs
from navstack.global_planner._search.orientation_filter import OrientationFilter, OrientationMode
from navstack.global_planner._search.start_goal import StartPolicy, unknown_not_tracked
from navstack.plugins import CheckContext, Issue, param

_EPSILON: Final = 1e-9


class CellPlannerParams(SearchParams):
    """Parameters of the planners that search from cell to cell."""

    allow_unknown: bool = param(
        True, "whether paths may cross unknown cells, which then cost as much as cells of cost 252"
    )
    neutral_cost: float = param(50.0, "cost of crossing a cell of cost 0", ge=1e-3, le=1e6)
    cost_factor: float = param(
        0.8,
        "additional cost per unit of the costmap's cost; 0 = the shortest path, whose cost with neutral_cost 1 is its length in "
        "cells",
        ge=0.0,
        le=1e4,
    )
    heuristic_weight: float = param(
        1.0,
        "factor on the heuristic: 0 Dijkstra, 1 A*; above 1 faster, for a path that costs at most that factor more",
        ge=0.0,
        le=100.0,
    )
    cut_corners: bool = param(
        False,
        "whether a diagonal step needs only one free orthogonal neighbor instead of both; it never passes between two blocked "
        "cells",
    )
    start_policy: StartPolicy = param(
        "clear_footprint",
        "what to do when the start is blocked: treat its cell as free, treat all cells under the footprint as free, start from "
        "the nearest free cell, or refuse",
    )
    orientation_mode: int = param(
        1,
        "headings: 0 none, 1 forward, 2 interpolate, 3 forward then interpolate, 4 backward, 5 leftward, 6 rightward",
        ge=0,
        le=6,
    )

    def check(self, context: CheckContext) -> Iterator[Issue]:
        """Yield an issue if `allow_unknown` has no effect."""
        return unknown_not_tracked(context, self.allow_unknown)


class CellPath(NamedTuple):
    """A path that runs straight between the centers of cells."""

    corners: NDArray[np.int64]
    """(n, 2) ix, iy."""
    cost: float
    expanded: int
    window: Window
    """Contains all cells that were read."""


CellExpansion = Callable[[BestFirst, Query, Cell, int], CellPath | None]
"""Finds the path from the start of a query to a goal cell with at most so many expansions.

If it returns None, the BestFirst contains what was reached: all that is reachable, unless the search was exhausted.
"""


def octile_expansion(search: BestFirst, query: Query, goal: Cell, max_expanded: int) -> CellPath | None:
    """The expansion of A* over the 8 neighbors of each cell."""
    start = query.start_cell
    if not search.octile(query.space.costmap, start, goal, max_expanded=max_expanded):
        return None
    return CellPath(search.path(start, goal), search.cost_of(goal), search.expanded, search.window)


class CellSearch(Search):
    """An expansion over the cells of a costmap, with these costs."""

    def __init__(
        self,
        costs: CellCosts,
        expansion: CellExpansion,
        *,
        heuristic_weight: float = 1.0,
        cut_corners: bool = False,
        max_expanded: int = UNLIMITED,
    ) -> None:
        super().__init__(costs, border_blocked=False)
        self.best_first = BestFirst(costs, heuristic_weight=heuristic_weight, cut_corners=cut_corners)
        self._expansion = expansion
        self._cut_corners = cut_corners
        self._max_expanded = max_expanded

    def reset(self) -> None:
        """Do nothing: a search does not depend on earlier ones."""

    def find(self, query: Query, goal_cell: Cell) -> Route | Unreachable:
        """The path to the first reachable goal."""
        search = self.best_first
        goal, cell = query.goals[0]
        path = self._expansion(search, query, cell, self._max_expanded)
        if path is None:
            reached = next((g for g in query.goals if search.cost_of(g[1]) < math.inf), None)
            if reached is None:
                nearest = search.nearest_reached(goal_cell)
                return Unreachable(nearest, search.expanded, search.is_exhausted, search.expanded > 1)
            goal, cell = reached
            path = self._expansion(search, query, cell, UNLIMITED)
            assert path is not None
        potential: NDArray[np.float32] | None = None
        if query.keep_potential:
            potential = search.potential()
            potential[cell[1], cell[0]] = path.cost
        points = self._points(query, goal, path.corners)
        return Route(goal, path.cost, points, path.expanded, potential, path.window)

    def _points(self, query: Query, goal: Pose2D, corners: NDArray[np.int64]) -> NDArray[np.float64]:
        """(n, 2) points (m), at most a cell apart: from the start, or after a lead from the first cell center."""
        g = query.space.costmap.geometry
        centers = (corners + 0.5) * g.resolution + np.array([g.origin_x, g.origin_y])
        steps = np.abs(np.diff(corners, axis=0)).max(axis=1) if len(corners) > 1 else np.zeros(0, np.int64)
        has_lead = len(query.lead) > 0
        # start and goal can be connected to the next center directly: both cells next to a diagonal are free
        direct = bool((steps <= 1).all()) and not self._cut_corners
        parts = [centers[:1]] if has_lead else [np.array([query.start[:2]])]
        if not (has_lead or direct or _is_at(centers[0], query.start)):
            parts.append(centers[:1])
        for a, b, n in zip(centers[:-1], centers[1:], steps.tolist(), strict=True):
            parts.append(a + (b - a) * (np.arange(1, n + 1) / n)[:, None])
        points = np.concatenate(parts).astype(np.float64, copy=False)
        has_inner = has_lead or len(points) > 1
        return points[:-1] if has_inner and (direct or _is_at(points[-1], goal)) else points


def _is_at(point: NDArray[np.float64], pose: Pose2D) -> bool:
    return math.hypot(point[0] - pose.x, point[1] - pose.y) < _EPSILON


class CellPlanner(SearchPlanner):
    """A planner whose path runs straight from cell center to cell center.

    The cost of a stretch is its length in cells times the weight of the cells it crosses, `neutral_cost + cost_factor *
    cost`; a step to a neighbor is half in each. Cells of cost 253 and 254 are blocked; unknown cells weigh as much as cost
    252, or are blocked. The outermost cells of the map are treated like all others. `Plan.cost` is the cost between the
    start and goal cells.
    """

    def __init__(self, params: CellPlannerParams, expansion: CellExpansion) -> None:
        search = CellSearch(
            cell_costs(params.allow_unknown, params.neutral_cost, params.cost_factor),
            expansion,
            heuristic_weight=params.heuristic_weight,
            cut_corners=params.cut_corners,
            max_expanded=params.expansion_limit,
        )
        super().__init__(params, search, OrientationFilter(OrientationMode(params.orientation_mode), sets_start=True))
