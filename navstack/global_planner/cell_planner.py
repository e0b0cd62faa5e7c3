"""What astar and theta_star share: parameters, the two ends, and poses along a path of cells."""

from __future__ import annotations

import math
from abc import abstractmethod
from functools import cache
from typing import Final, Literal, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from navstack.core import FREE, INSCRIBED, LETHAL, UNKNOWN, Costmap, Footprint, Path, Pose2D
from navstack.core.errors import StartOccupiedError
from navstack.core.parameters import ParamModel, param
from navstack.global_planner import ends
from navstack.global_planner.cell_search import CellSearch, Weights
from navstack.global_planner.cost_rule import CostRule, rule_of
from navstack.global_planner.orientation_filter import OrientationMode, orient
from navstack.global_planner.replanning import Memory, Request
from navstack.interfaces import GlobalPlanner, Plan

_HAIR: Final = 1e-9


class CellPlannerParams(ParamModel):
    """Parameters of the planners that search cell by cell."""

    allow_unknown: bool = param(True, "whether paths may cross unknown cells (as dear as the dearest free ones)")
    default_tolerance: float = param(
        0.0,
        "half the side of the square around the goal in which the nearest reachable point will do",
        unit="m",
        ge=0.0,
    )
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
    start_policy: Literal["clear_footprint", "nearest_free", "refuse"] = param(
        "clear_footprint",
        "when the start is blocked: take the cells under the footprint for free, begin at the nearest free cell, or refuse",
    )
    orientation_mode: int = param(
        1,
        "headings: 0 none, 1 forward, 2 interpolate, 3 forward then interpolate, 4 backward, 5 leftward, 6 rightward",
        ge=0,
        le=6,
    )


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
    def _find(self, costmap: Costmap, weights: Weights, start: ends.Cell, goal: ends.Cell) -> Found | None:
        """The path between two cells; None when there is none, and then `_search` holds all that can be reached."""

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
        Raises StartOutsideMapError, GoalOutsideMapError, StartOccupiedError, GoalOccupiedError, NoValidPathError, and
        InputError for a pose that is not finite.
        """
        params = cast("CellPlannerParams", self.params)
        rule, weights = _rule_and_weights(params.allow_unknown, params.neutral_cost, params.cost_factor)
        start_cell, goal_cell = ends.cells_of(costmap, start, goal)
        request = Request(start, goal, costmap.geometry, costmap.frame, keep_potential)
        known = self._memory.recall(costmap, request)
        if known is not None:
            return known
        notes: list[str] = []
        grid, first = costmap, start_cell
        if ends.is_blocked(costmap, rule, start_cell, ring=False):
            grid, first, note = self._leave(costmap, rule, start, start_cell, footprint)
            notes.append(note)
        candidates = ends.goal_candidates(costmap, goal, params.default_tolerance)
        free = [c for c in candidates if c[1] == first or not ends.is_blocked(grid, rule, c[1], ring=False)]
        if not free:
            raise ends.goal_occupied(costmap, rule, goal, goal_cell, params.default_tolerance, ring=False)
        used, cell = free[0]
        found = self._find(grid, weights, first, cell)
        if found is None:
            reached = next((c for c in free if self._search.cost_of(c[1]) < math.inf), None)
            if reached is None:
                if self._search.expanded <= 1 and ends.is_blocked(grid, rule, first, ring=False):
                    raise ends.start_occupied(costmap, rule, start, start_cell, ring=False)
                nearest = self._search.nearest_reached(goal_cell)
                raise ends.no_path(costmap, rule, start, goal, (first, goal_cell), nearest, self._search.expanded)
            used, cell = reached
            found = self._find(grid, weights, first, cell)
            assert found is not None
        moved = goal.distance_to(used)
        if moved > 0.0:
            notes.append(f"the goal cannot be reached; the plan ends {moved:.2f} m from it (default_tolerance)")
        plan = Plan(
            path=Path(self._poses(costmap, start, used, found.corners), costmap.frame),
            cost=found.cost,
            goal=used,
            goal_moved_m=moved,
            cells_expanded=found.expanded,
            potential=self._search.potential() if keep_potential else None,
            notes=tuple(notes),
        )
        whole = (0, 0, costmap.geometry.nx, costmap.geometry.ny)
        everything = notes or params.default_tolerance > 0.0
        self._memory.remember(costmap, request, plan, whole if everything else found.rectangle)
        return plan

    def _leave(
        self, costmap: Costmap, rule: CostRule, start: Pose2D, cell: ends.Cell, footprint: Footprint | None
    ) -> tuple[Costmap, ends.Cell, str]:
        """What `start_policy` makes of a blocked start: the costs to plan on, the cell to begin in, and a note."""
        policy = cast("CellPlannerParams", self.params).start_policy
        if policy == "refuse":
            error = ends.start_occupied(costmap, rule, start, cell, ring=False)
            raise StartOccupiedError(
                error.message.replace(", with no free cell beside it", "") + " (start_policy is refuse)", **error.data
            )
        if policy == "nearest_free":
            free = ends.nearest_free(costmap, rule, cell, ring=False)
            if free is None:
                raise ends.start_occupied(costmap, rule, start, cell, ring=False)
            x, y = costmap.geometry.cell_to_world(*free[0])
            return (
                costmap,
                free[0],
                (
                    "the start lies in a blocked cell; the plan begins at the nearest free one, "
                    f"{free[1]:.2f} m away at ({x:.2f}, {y:.2f})"
                ),
            )
        if footprint is None:
            return costmap, cell, "the start lies in a blocked cell, which was taken for free"
        cleared = costmap.copy()
        cleared.data[_under(costmap, footprint, start)] = FREE
        return cleared, cell, "the start lies in a blocked cell; the cells under the footprint were taken for free"

    def _poses(self, costmap: Costmap, start: Pose2D, goal: Pose2D, corners: NDArray[np.int64]) -> NDArray[np.float64]:
        """(n, 3): the start, points at most a cell apart along the corners, the goal."""
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
        jump = math.hypot(inner[0, 0] - start.x, inner[0, 1] - start.y)
        if jump > g.resolution:  # nearest_free
            n = math.ceil(jump / g.resolution)
            ahead = np.array(start[:2]) + (inner[0] - start[:2]) * (np.arange(1, n) / n)[:, None]
            inner = np.concatenate([ahead, inner])
        elif straight or jump < _HAIR:
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


def _under(costmap: Costmap, footprint: Footprint, pose: Pose2D) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Indices of the cells whose centre lies under the footprint, and of the one that holds the pose."""
    import shapely

    g = costmap.geometry
    outline = footprint.at(pose)
    x0, y0 = g.world_to_cell_unbounded(*outline.min(axis=0))
    x1, y1 = g.world_to_cell_unbounded(*outline.max(axis=0))
    xs, ys = np.meshgrid(np.arange(max(x0, 0), min(x1 + 1, g.nx)), np.arange(max(y0, 0), min(y1 + 1, g.ny)))
    inside = shapely.contains_xy(
        shapely.Polygon(outline), g.origin_x + (xs + 0.5) * g.resolution, g.origin_y + (ys + 0.5) * g.resolution
    )
    own = g.world_to_cell_unbounded(pose.x, pose.y)
    inside |= (xs == own[0]) & (ys == own[1])
    return ys[inside], xs[inside]
