"""The frame of all planners that search: parameters, and `make_plan` around a search.

A search is composed of a cost interpreter, an expansion and a traceback; see `wave_search` and `cell_search`.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import ClassVar, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, Footprint, Path, Pose2D, Window
from navstack.global_planner._search import planning_errors as errors
from navstack.global_planner._search.best_first import UNLIMITED
from navstack.global_planner._search.cells import Cell, CostInterpreter, SearchSpace
from navstack.global_planner._search.orientation_filter import OrientationFilter
from navstack.global_planner._search.plan_cache import PlanCache, Request
from navstack.global_planner._search.start_goal import (
    SearchStart,
    StartPolicy,
    apply_start_policy,
    cells_of,
    goal_candidates,
    with_yaw_in_range,
)
from navstack.plugins import GlobalPlanner, ParamModel, Plan, param


class SearchParams(ParamModel):
    """Parameters of every planner that searches."""

    default_tolerance: float = param(
        0.0,
        "half the side of the square around the goal; if the goal is unreachable, the plan ends at the nearest reachable point "
        "in it",
        unit="m",
        ge=0.0,
    )
    start_policy: StartPolicy = param(
        "clear_cell",
        "what to do when the start is blocked: treat its cell as free (as C++), treat all cells under the footprint as free, "
        "start from the nearest free cell, or refuse",
    )
    max_expansions: int = param(
        0,
        "limit on the cells a search may expand, after which it fails with TIMEOUT; 0 = no limit. Counted, not timed, so the "
        "result is the same on every machine",
        ge=0,
    )

    @property
    def expansion_limit(self) -> int:
        """`max_expansions`, with a large number for no limit."""
        return self.max_expansions or UNLIMITED


class Query(NamedTuple):
    """The input of a search."""

    space: SearchSpace
    start: Pose2D
    start_cell: Cell
    lead: NDArray[np.float64]
    """(n, 2) points of the path before `start`, see `SearchStart`."""
    goals: Sequence[tuple[Pose2D, Cell]]
    """Acceptable goals that are not blocked, in order of preference; at least one."""
    keep_potential: bool


class Route(NamedTuple):
    """A path that a search found."""

    goal: Pose2D
    cost: float
    points: NDArray[np.float64]
    """(n, 2) points (m) that follow the lead, excluding the goal."""
    expanded: int
    potential: NDArray[np.float32] | None
    window: Window | None
    """Contains all cells that affect the result; None if that may be any cell."""
    snapshot: NDArray[np.uint8] | None = None
    """(ny, nx) a copy of the costs, if the search keeps one anyway; unchanged until the next search."""


class Unreachable(NamedTuple):
    """The result of a search that reached none of the goals."""

    nearest: Cell
    """The reached cell nearest to the goal."""
    expanded: int
    is_exhausted: bool
    """Whether the search ended because of `max_expansions`."""
    left_start: bool
    """Whether it expanded any cell other than the start."""


class Search(ABC):
    """Finds a path between two cells, and keeps its arrays and potentials for the next query."""

    def __init__(self, costs: CostInterpreter, *, border_blocked: bool) -> None:
        self.costs = costs
        self.border_blocked = border_blocked
        """Whether the outermost cells of the map are blocked."""

    @abstractmethod
    def find(self, query: Query, goal_cell: Cell) -> Route | Unreachable:
        """The path to the first of the query's goals that is reachable; `goal_cell`: the cell of the requested goal."""

    @abstractmethod
    def reset(self) -> None:
        """Discard everything that affects how the next query is searched."""


class SearchPlanner(GlobalPlanner):
    """A planner that searches: subclasses pass a search and the headings of their paths to the constructor."""

    limit_name: ClassVar[str] = "max_expansions"
    """Name of the parameter that limits a search."""
    tolerance_name: ClassVar[str] = "default_tolerance"

    def __init__(self, params: SearchParams, search: Search, orientation: OrientationFilter | None = None) -> None:
        super().__init__(params)
        self._search = search
        self._orientation = orientation or OrientationFilter()
        self._cache = PlanCache()

    def reset(self) -> None:
        """Discard the cached plan and potentials: the next plan is computed from scratch."""
        self._search.reset()
        self._cache = PlanCache()

    def make_plan(
        self,
        costmap: Costmap,
        start: Pose2D,
        goal: Pose2D,
        *,
        footprint: Footprint | None = None,
        keep_potential: bool = False,
    ) -> Plan:
        """Plan between two poses in the frame of the costmap. The potential is 0 at the start.

        Raises StartOutsideMapError, GoalOutsideMapError, StartOccupiedError, GoalOccupiedError, NoValidPathError,
        PlanningTimeoutError, and InputError for a pose that is not finite.
        """
        began = time.perf_counter()
        start, goal = with_yaw_in_range(start), with_yaw_in_range(goal)
        start_cell, goal_cell = self._cells_of(costmap, start, goal)
        request = Request(start, goal, costmap.geometry, costmap.frame, keep_potential, footprint)
        cached = self._cache.lookup(costmap, request)
        if cached is not None:
            return cached
        params = cast("SearchParams", self.params)
        space = SearchSpace(costmap, self._search.costs, self._search.border_blocked)
        begin = apply_start_policy(space, start, start_cell, footprint, params.start_policy)
        goals = self._goals(begin, goal, params.default_tolerance)
        if not goals:
            raise errors.goal_occupied(space, goal, goal_cell, params.default_tolerance)
        query = Query(begin.space, begin.pose, begin.cell, begin.lead, goals, keep_potential)
        route = self._search.find(query, goal_cell)
        if isinstance(route, Unreachable):
            raise self._error(space, begin, request, (start_cell, goal_cell), route)
        plan = self._plan(request, begin, route, began)
        self._cache.store(costmap, request, plan, *self._dependencies(costmap, begin, route))
        return plan

    def _cells_of(self, costmap: Costmap, start: Pose2D, goal: Pose2D) -> tuple[Cell, Cell]:
        """The cells of start and goal. Raises InputError, StartOutsideMapError or GoalOutsideMapError."""
        return cells_of(costmap, start, goal)

    def _goals(self, begin: SearchStart, goal: Pose2D, tolerance: float) -> Sequence[tuple[Pose2D, Cell]]:
        """The acceptable goals with their cells, in order of preference."""
        return [
            (pose, cell)
            for pose, cell in goal_candidates(begin.space.costmap, goal, tolerance)
            if cell == begin.cell or not begin.space.is_blocked(cell)
        ]

    def _plan(self, request: Request, begin: SearchStart, route: Route, began: float) -> Plan:
        poses = np.zeros((len(begin.lead) + len(route.points) + 1, 3))
        poses[: len(begin.lead), :2] = begin.lead
        poses[len(begin.lead) : -1, :2] = route.points
        poses[-1] = route.goal
        self._orientation.apply(poses, request.start.yaw)
        notes = [] if begin.note is None else [begin.note]
        moved = request.goal.distance_to(route.goal)
        if moved > 0.0:
            notes.append(f"the goal is unreachable; the plan ends {moved:.2f} m from it ({self.tolerance_name})")
        return Plan(
            path=Path(poses, request.frame),
            cost=route.cost,
            goal=route.goal,
            goal_moved_m=moved,
            cells_expanded=route.expanded,
            potential=route.potential,
            notes=tuple(notes),
            took_s=time.perf_counter() - began,
        )

    def _dependencies(
        self, costmap: Costmap, begin: SearchStart, route: Route
    ) -> tuple[Window, NDArray[np.uint8] | None]:
        """The cells of the costmap that the plan depends on, and a copy of the costs if there is one."""
        is_copy = begin.space.costmap is not costmap
        tolerant = cast("SearchParams", self.params).default_tolerance > 0.0
        anywhere = route.window is None or is_copy or len(begin.lead) > 0 or tolerant
        window = costmap.geometry.window if anywhere or route.window is None else route.window
        return window, None if is_copy else route.snapshot

    def _error(
        self, space: SearchSpace, begin: SearchStart, request: Request, cells: tuple[Cell, Cell], result: Unreachable
    ) -> Exception:
        start, goal = request.start, request.goal
        if result.is_exhausted:
            limit = cast("SearchParams", self.params).expansion_limit
            return errors.timeout(
                space.costmap,
                start,
                goal,
                result.nearest,
                expanded=result.expanded,
                max_expansions=limit,
                name=self.limit_name,
            )
        if not result.left_start and begin.space.is_blocked(begin.cell):
            return errors.start_occupied(space, start, cells[0])
        return errors.no_path(
            begin.space, start, goal, (begin.cell, cells[1]), result.nearest, expanded=result.expanded
        )
