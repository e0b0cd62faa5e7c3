"""What astar and theta_star share: parameters, the two ends, and poses along a path of cells."""

from __future__ import annotations

import math
import time
from abc import abstractmethod
from collections.abc import Iterator
from functools import cache
from typing import Final, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from navstack.core import INSCRIBED, LETHAL, UNKNOWN, Costmap, Footprint, Path, Pose2D
from navstack.core.parameter_checks import CheckContext, Issue
from navstack.core.parameters import param
from navstack.global_planner import ends
from navstack.global_planner.cell_search import EVERYTHING, CellSearch, Weights
from navstack.global_planner.cost_rule import CostRule, rule_of
from navstack.global_planner.departure import StartPolicy, depart
from navstack.global_planner.orientation_filter import OrientationMode, orient
from navstack.global_planner.parameter_checks import unknown_not_tracked
from navstack.global_planner.replanning import Memory, Request
from navstack.global_planner.search_params import SearchParams
from navstack.interfaces import GlobalPlanner, Plan

_HAIR: Final = 1e-9


class CellPlannerParams(SearchParams):
    """Parameters of the planners that search cell by cell."""

    allow_unknown: bool = param(True, "whether paths may cross unknown cells (as dear as the dearest free ones)")
    neutral_cost: float = param(50.0, "cost of a cell's width in a cell of cost 0", ge=1e-3, le=1e6)
    cost_factor: float = param(
        0.8,
        "what each unit of the costmap's cost adds to that; 0 = the shortest path, with neutral_cost 1 in cells",
        ge=0.0,
        le=1e4,
    )
    heuristic_weight: float = param(
        1.0,
        "factor on the heuristic: 0 Dijkstra, 1 A*, above 1 faster for a path at most so many times dearer",
        ge=0.0,
        le=100.0,
    )
    cut_corners: bool = param(
        False, "a diagonal step needs one free orthogonal neighbour instead of both; never between two blocked ones"
    )
    start_policy: StartPolicy = param(
        "clear_footprint",
        "when the start is blocked: take its cell for free, all cells under the footprint, begin at the nearest free cell, or "
        "refuse",
    )
    orientation_mode: int = param(
        1,
        "headings: 0 none, 1 forward, 2 interpolate, 3 forward then interpolate, 4 backward, 5 leftward, 6 rightward",
        ge=0,
        le=6,
    )

    def check(self, context: CheckContext) -> Iterator[Issue]:
        """Yield whether `allow_unknown` has an effect."""
        return unknown_not_tracked(context, self.allow_unknown)


class Found(NamedTuple):
    """A path of cells between which it runs straight."""

    corners: NDArray[np.int64]
    """(n, 2) ix, iy."""
    cost: float
    expanded: int
    rectangle: tuple[int, int, int, int]
    """(x0, y0, x1, y1): all cells that were looked at."""


class CellPlanner(GlobalPlanner):
    """A planner whose path runs straight from cell centre to cell centre.

    The cost of a stretch is its length in cells times the weight of the cells it lies in, `neutral_cost + cost_factor * cost`;
    a step to a neighbour lies half in each. Cells of cost 253 and 254 are blocked; unknown ones weigh as cost 252, or are
    blocked. The map's outermost cells are cells as any other.
    """

    def __init__(self, params: CellPlannerParams) -> None:
        super().__init__(params)
        self._search = CellSearch()
        self._memory = Memory()

    def forget(self) -> None:
        """The next plan is made from scratch."""
        self._memory = Memory()

    @abstractmethod
    def _find(self, costmap: Costmap, weights: Weights, start: ends.Cell, goal: ends.Cell, most: int) -> Found | None:
        """The path between two cells; None when there is none, and then `_search` holds what was reached.

        That is all that can be, unless it gave up after `most` expansions.
        """

    def make_plan(
        self,
        costmap: Costmap,
        start: Pose2D,
        goal: Pose2D,
        *,
        footprint: Footprint | None = None,
        keep_potential: bool = False,
    ) -> Plan:
        """A plan between two poses in the costmap's frame: the start, the centres of cells at most one apart, the goal.

        `Plan.cost` is that of the way between the two cells; `potential` is 0 at the start and covers what was searched.
        Raises StartOutsideMapError, GoalOutsideMapError, StartOccupiedError, GoalOccupiedError, NoValidPathError,
        PlanningTimeoutError, and InputError for a pose that is not finite.
        """
        began = time.perf_counter()
        params = cast("CellPlannerParams", self.params)
        rule, weights = _rule_and_weights(params.allow_unknown, params.neutral_cost, params.cost_factor)
        start, goal = ends.with_yaw_in_range(start), ends.with_yaw_in_range(goal)
        start_cell, goal_cell = ends.cells_of(costmap, start, goal)
        request = Request(start, goal, costmap.geometry, costmap.frame, keep_potential, footprint)
        known = self._memory.recall(costmap, request)
        if known is not None:
            return known
        departure = depart(costmap, rule, start, start_cell, footprint, params.start_policy, ring=False)
        grid, first = departure.costmap, departure.cell
        notes = [] if departure.note is None else [departure.note]
        candidates = ends.goal_candidates(costmap, goal, params.default_tolerance)
        free = [c for c in candidates if c[1] == first or not ends.is_blocked(grid, rule, c[1], ring=False)]
        if not free:
            raise ends.goal_occupied(costmap, rule, goal, goal_cell, params.default_tolerance, ring=False)
        used, cell = free[0]
        found = self._find(grid, weights, first, cell, params.most)
        if found is None:
            reached = next((c for c in free if self._search.cost_of(c[1]) < math.inf), None)
            if reached is None and self._search.is_exhausted:
                nearest = self._search.nearest_reached(goal_cell)
                raise ends.timeout(costmap, start, goal, nearest, self._search.expanded, params.most)
            if reached is None:
                if self._search.expanded <= 1 and ends.is_blocked(grid, rule, first, ring=False):
                    raise ends.start_occupied(costmap, rule, start, start_cell, ring=False)
                nearest = self._search.nearest_reached(goal_cell)
                raise ends.no_path(costmap, rule, start, goal, (first, goal_cell), nearest, self._search.expanded)
            used, cell = reached
            found = self._find(grid, weights, first, cell, EVERYTHING)
            assert found is not None
        moved = goal.distance_to(used)
        if moved > 0.0:
            notes.append(f"the goal cannot be reached; the plan ends {moved:.2f} m from it (default_tolerance)")
        potential: NDArray[np.float32] | None = None
        if keep_potential:
            potential = self._search.potential()
            potential[cell[1], cell[0]] = found.cost
        plan = Plan(
            path=Path(self._poses(costmap, start, departure.lead, used, found.corners), costmap.frame),
            cost=found.cost,
            goal=used,
            goal_moved_m=moved,
            cells_expanded=found.expanded,
            potential=potential,
            notes=tuple(notes),
            took_s=time.perf_counter() - began,
        )
        whole = (0, 0, costmap.geometry.nx, costmap.geometry.ny)
        everything = notes or params.default_tolerance > 0.0
        self._memory.remember(costmap, request, plan, whole if everything else found.rectangle)
        return plan

    def _poses(
        self,
        costmap: Costmap,
        start: Pose2D,
        lead: NDArray[np.float64],
        goal: Pose2D,
        corners: NDArray[np.int64],
    ) -> NDArray[np.float64]:
        """(n, 3): the start, the lead (m,2) to the first corner, points at most a cell apart along the corners, the goal."""
        params = cast("CellPlannerParams", self.params)
        g = costmap.geometry
        points = (corners + 0.5) * g.resolution + (g.origin_x, g.origin_y)
        steps = np.abs(np.diff(corners, axis=0)).max(axis=1) if len(corners) > 1 else np.zeros(0, np.int64)
        xy = [points[:1]]
        for a, b, n in zip(points[:-1], points[1:], steps.tolist(), strict=True):
            xy.append(a + (b - a) * (np.arange(1, n + 1) / n)[:, None])
        inner = np.concatenate(xy)
        # from anywhere in a cell straight to the next centre: both cells beside a diagonal are free
        straight = bool((steps <= 1).all()) and not params.cut_corners
        if len(lead):
            inner = np.concatenate([lead[1:], inner])
        elif straight or math.hypot(inner[0, 0] - start.x, inner[0, 1] - start.y) < _HAIR:
            inner = inner[1:]
        if len(inner) and (straight or math.hypot(inner[-1, 0] - goal.x, inner[-1, 1] - goal.y) < _HAIR):
            inner = inner[:-1]
        poses = np.zeros((len(inner) + 2, 3))
        poses[0] = start
        poses[1:-1, :2] = inner
        poses[-1] = goal
        orient(poses, start.yaw, OrientationMode(params.orientation_mode))
        return poses


@cache
def _rule_and_weights(allow_unknown: bool, neutral: float, factor: float) -> tuple[CostRule, Weights]:
    bytes_ = np.arange(256)
    blocked = (bytes_ == INSCRIBED) | (bytes_ == LETHAL)
    blocked[UNKNOWN] = not allow_unknown
    table = neutral + factor * np.minimum(bytes_, INSCRIBED - 1)
    rule = rule_of(table.astype(np.float32), blocked, neutral, False, allow_unknown)
    table[blocked] = np.inf
    table.setflags(write=False)
    return rule, Weights(table, neutral)
