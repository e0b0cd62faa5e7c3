"""theta_star: any-angle paths (A. Nash, K. Daniel, S. Koenig, A. Felner, 2007), and Nav2's planner of that name."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from fractions import Fraction
from functools import cache
from itertools import pairwise
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from navstack.core import LETHAL, Costmap, Footprint, Path, Pose2D, kernel
from navstack.global_planner._search.base import Query, Route, Search, SearchPlanner, Unreachable
from navstack.global_planner._search.best_first import UNLIMITED, BestFirst
from navstack.global_planner._search.cell_search import CellPath, CellPlanner, CellPlannerParams
from navstack.global_planner._search.cells import Cell, cell_costs, union
from navstack.global_planner._search.plan_cache import Request
from navstack.global_planner._search.start_goal import (
    SearchStart,
    StartPolicy,
    cells_of,
    unknown_not_tracked,
    with_yaw_in_range,
)
from navstack.plugins import GLOBAL_PLANNERS, CheckContext, Issue, ParamModel, Plan, param


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


# ----------------------------------------------------------------------------------------------------------------------
# The lazy Theta* of Nav2. Cells are numbered k = iy * nx + ix.
#
# The open list is a binary heap that is not repaired when the value of a queued cell falls, as in Nav2, whose heap is the one of
# the C++ library: the order in which cells are expanded decides which corners a path gets.


# pyright: basic


UNREACHED = np.inf
STEPS_X = np.array([0, 0, 1, -1, 1, -1, 1, -1], np.int64)
STEPS_Y = np.array([1, -1, 0, 0, -1, 1, 1, -1], np.int64)
SEEN_THROUGH = 252.0
"""Largest traversal value (26 + 0.9 * cost) of a cell that a line may cross: cells of cost 252 are entered, but not crossed."""


@kernel
def _raise_entry(heap, values, hole, entry):
    """Move an entry up from position `hole` to its place."""
    value = values[np.uint64(entry)]
    while hole > 0:
        above = (hole - 1) >> 1
        other = heap[np.uint64(above)]
        if not values[np.uint64(other)] > value:
            break
        heap[np.uint64(hole)] = other
        hole = above
    heap[np.uint64(hole)] = entry


@kernel
def _pop_lowest(heap, values, size):
    """Remove the first of `size` entries and return it: the hole sinks to a leaf, which the last entry is raised from."""
    lowest, last = heap[0], heap[size - 1]
    size -= 1
    if size == 0:
        return lowest
    hole = below = 0
    while below < (size - 1) >> 1:
        below = 2 * (below + 1)
        right, left = heap[np.uint64(below)], heap[np.uint64(below - 1)]
        if values[np.uint64(right)] > values[np.uint64(left)]:
            below -= 1
            right = left
        heap[np.uint64(hole)] = right
        hole = below
    if size % 2 == 0 and below == (size - 2) // 2:
        below = 2 * below + 1
        heap[hole] = heap[below]
        hole = below
    _raise_entry(heap, values, hole, last)
    return lowest


@kernel
def sight_cost(cost, blocked, values, weight, nx, x0, y0, x1, y1):
    """Return the traversal cost of the cells on the line from (x0, y0) to (x1, y1), the last one excluded; -1 if it is blocked.

    A diagonal step needs both cells beside it.
    """
    dx, dy = abs(x1 - x0), abs(y1 - y0)
    sx, sy = (1 if x0 < x1 else -1), (nx if y0 < y1 else -nx)
    k, end, error = y0 * nx + x0, y1 * nx + x1, dx - dy
    total = 0.0
    while k != end:
        byte = cost[np.uint64(k)]
        value = values[byte]
        if byte == 255:
            if blocked[255]:
                return -1.0
            value = 253.0
        elif not value <= SEEN_THROUGH:
            return -1.0
        total += weight * value * value / 252.0 / 252.0
        twice = 2 * error
        if twice > -dy and twice <= dx:
            if blocked[cost[np.uint64(k + sx)]] or blocked[cost[np.uint64(k + sy)]]:
                return -1.0
            k, error = k + sx + sy, error + dx - dy
        elif twice > -dy:
            k, error = k + sx, error - dy
        else:
            k, error = k + sy, error + dx
    return total


@kernel
def lazy_theta_star(cost, blocked, values, weights, nx, ny, start, goal, steps, f, g, parent, queued):
    """Search from the cell `start` to `goal`; return how many cells were expanded, negative if the goal was not reached.

    `values` (256,): traversal value by byte. `weights`: of length (per cell), traversal and heuristic. `steps`: 4 or 8
    neighbors. `f` must be inf and `queued` 0 everywhere. A cell that is reached gets its value in `f` and its parent; the parent
    of the start is the start.
    """
    euclidean, traversal, heuristic = weights
    goal_x, goal_y = goal % nx, goal // nx
    heap = np.empty(1024, np.int64)
    value = values[cost[start]]
    g[start] = traversal * value * value / 252.0 / 252.0
    f[start] = g[start] + heuristic * math.hypot(start % nx - goal_x, start // nx - goal_y)
    parent[start] = start
    queued[start] = 1
    heap[0] = start
    size = 1
    k = start
    expanded = 0
    while True:
        expanded += 1
        if k == goal:
            return expanded
        queued[k] = 0
        y = np.int64(np.uint32(k) // np.uint32(nx))
        x = k - y * nx
        above = parent[parent[k]]
        ay = np.int64(np.uint32(above) // np.uint32(nx))
        ax = above - ay * nx
        line = sight_cost(cost, blocked, values, traversal, nx, x, y, ax, ay)
        if line >= 0.0:
            through = g[above] + euclidean * math.hypot(x - ax, y - ay) + line
            if through < g[k]:
                parent[k] = above
                g[k] = through
                f[k] = through + heuristic * math.hypot(x - goal_x, y - goal_y)
        for i in range(steps):
            nearby_x, nearby_y = x + STEPS_X[i], y + STEPS_Y[i]
            if nearby_x < 0 or nearby_y < 0 or nearby_x >= nx or nearby_y >= ny:
                continue
            n = nearby_y * nx + nearby_x
            byte = cost[n]
            if blocked[byte]:
                continue
            value = values[byte]
            here = g[k] + euclidean * math.hypot(x - nearby_x, y - nearby_y) + traversal * value * value / 252.0 / 252.0
            whole = here + heuristic * math.hypot(nearby_x - goal_x, nearby_y - goal_y)
            if f[n] > whole:
                g[n], f[n], parent[n] = here, whole, k
                if not queued[n]:
                    queued[n] = 1
                    if size == heap.size:
                        larger = np.empty(2 * size, np.int64)
                        for j in range(size):
                            larger[j] = heap[j]
                        heap = larger
                    _raise_entry(heap, f, size, n)
                    size += 1
        if size == 0:
            return -expanded
        k = _pop_lowest(heap, f, size)
        size -= 1


# pyright: standard


class Nav2ThetaStarParams(ParamModel):
    """Parameters of Nav2's ThetaStarPlanner."""

    NO_EFFECT: ClassVar[Mapping[str, str]] = {
        "terminal_checking_interval": "a plan is not canceled while it is computed",
        "w_heuristic_cost": "min(1, w_euc_cost), as in Nav2 since Humble",
    }

    how_many_corners: int = param(8, "neighbors of a cell: 4 or 8; another value counts as 8, as in Nav2")
    allow_unknown: bool = param(True, "whether paths may cross unknown cells")
    w_euc_cost: float = param(1.0, "weight of the length, per cell", ge=0.0)
    w_traversal_cost: float = param(
        2.0, "weight of the cells' costs: each cell adds this times ((26 + 0.9 * cost) / 252) squared", ge=0.0
    )
    use_final_approach_orientation: bool = param(
        False, "whether the heading at the end is that of the last step, not the goal's"
    )
    start_policy: StartPolicy = param(
        "clear_cell",
        "what to do when the start is blocked: treat its cell as free, treat all cells under the footprint as free, start from "
        "the nearest free cell, or refuse",
        ros_differs="Nav2 refuses, and frees that cell for the next plan",
    )

    default_tolerance: ClassVar[float] = 0.0
    expansion_limit: ClassVar[int] = UNLIMITED

    def check(self, context: CheckContext) -> Iterator[Issue]:
        """Yield an issue if `allow_unknown` has no effect."""
        return unknown_not_tracked(context, self.allow_unknown)


class LazyThetaStar(Search):
    """Nav2's Theta* over the cells of a costmap."""

    def __init__(self, params: Nav2ThetaStarParams) -> None:
        super().__init__(cell_costs(params.allow_unknown, 1.0, 1.0), border_blocked=False)
        self._params = params
        self._f = self._g = np.empty(0)
        self._parent = np.empty(0, np.int64)
        self._queued = np.empty(0, np.uint8)

    def reset(self) -> None:
        """Do nothing: a search does not depend on earlier ones."""

    def find(self, query: Query, goal_cell: Cell) -> Route | Unreachable:
        """The path to the goal; its points are those of Nav2, the last one is the center of the goal's cell."""
        costmap, p = query.space.costmap, self._params
        g = costmap.geometry
        size = g.nx * g.ny
        if len(self._f) != size:
            self._f, self._g = np.empty(size), np.empty(size)
            self._parent, self._queued = np.empty(size, np.int64), np.empty(size, np.uint8)
        self._f.fill(UNREACHED)
        self._queued.fill(0)
        cost = np.ascontiguousarray(costmap.data).reshape(-1)
        start, goal = query.start_cell[1] * g.nx + query.start_cell[0], goal_cell[1] * g.nx + goal_cell[0]
        if query.space.is_blocked(query.start_cell):
            cost = cost.copy()
            cost[start] = 0
        expanded = lazy_theta_star(
            cost,
            self.costs.blocked,
            traversal_values(),
            (p.w_euc_cost, p.w_traversal_cost, min(1.0, p.w_euc_cost)),
            g.nx,
            g.ny,
            start,
            goal,
            4 if p.how_many_corners == 4 else 8,
            self._f,
            self._g,
            self._parent,
            self._queued,
        )
        if expanded < 0:
            ys, xs = np.nonzero(self._f.reshape(g.shape) < UNREACHED)
            best = int(np.argmin((xs - goal_cell[0]) ** 2 + (ys - goal_cell[1]) ** 2))
            return Unreachable((int(xs[best]), int(ys[best])), -expanded, False, len(xs) > 1)
        corners = [goal]
        while corners[-1] != start:
            corners.append(int(self._parent[corners[-1]]))
        numbers = np.array(corners[::-1], np.int64)
        centers: NDArray[np.float64] = np.column_stack((numbers % g.nx, numbers // g.nx)).astype(np.float64) + 0.5
        points = interpolated(centers * g.resolution + np.array([g.origin_x, g.origin_y]), g.resolution)
        potential: NDArray[np.float32] | None = None
        if query.keep_potential:
            potential = np.where(self._f < UNREACHED, self._g, np.inf).astype(np.float32).reshape(g.shape)
        return Route(query.goals[0][0], float(self._g[goal]), points, expanded, potential, None)


@cache
def traversal_values() -> NDArray[np.float64]:
    """Return 26 + 0.9 * cost (256,) of every cost, rounded once as by processors with a fused multiply-add, which Nav2 has."""
    values = np.array([float(26 + Fraction(0.9) * byte) for byte in range(256)])
    values.setflags(write=False)
    return values


def interpolated(corners: NDArray[np.float64], spacing: float) -> NDArray[np.float64]:
    """Return the corners (n, 2) and points between them every `spacing` (m); a stretch ends with a step of up to twice that."""
    parts: list[NDArray[np.float64]] = []
    for here, after in pairwise(corners):
        step = after - here
        length = math.hypot(step[0], step[1])
        # of a stretch of whole cells rounding decides whether its last point is left out, as in Nav2
        numbers = np.arange(max(1, int(length / spacing)))[:, None]
        parts.append(here + numbers * spacing * (step / length))
    return np.concatenate([*parts, corners[-1:]])


@GLOBAL_PLANNERS.register("nav2_theta_star", aliases=("nav2_theta_star_planner/ThetaStarPlanner",))
class Nav2ThetaStarPlanner(SearchPlanner):
    """theta_star as in Nav2: lazy Theta* with Nav2's costs; the path ends at the center of the goal's cell.

    Where costs tie, another order of equal cells gives another path of nearly the same length. `theta_star` finds cheaper paths,
    and ends at the goal. Yaws are 0 but the last one.

    # Nav2 differs: it frees the start of the plan before, so that the first plan from an occupied start fails; it reports no path
    # if its queue happens to be empty when the goal is taken; a goal of cost 253 is an unknown error, here it is occupied.
    """

    Params = Nav2ThetaStarParams
    NAMESPACES: ClassVar[tuple[str, ...]] = ("GridBased",)
    params: Nav2ThetaStarParams

    def __init__(self, params: Nav2ThetaStarParams | None = None) -> None:
        p = params or Nav2ThetaStarParams()
        super().__init__(p, LazyThetaStar(p))  # pyright: ignore[reportArgumentType]

    def make_plan(
        self,
        costmap: Costmap,
        start: Pose2D,
        goal: Pose2D,
        *,
        footprint: Footprint | None = None,
        keep_potential: bool = False,
    ) -> Plan:
        """Plan between two poses in the frame of the costmap; errors as `SearchPlanner.make_plan`.

        In one cell, unless it is lethal, the plan is the pose of the start with the goal's heading.
        """
        start_cell, goal_cell = cells_of(costmap, start, goal)
        if start_cell == goal_cell and costmap.data[goal_cell[1], goal_cell[0]] != LETHAL:
            began = time.perf_counter()
            end = with_yaw_in_range(
                start if self.params.use_final_approach_orientation else start._replace(yaw=goal.yaw)
            )
            path = Path(np.array([end], np.float64), costmap.frame)
            return Plan(
                path=path, cost=0.0, goal=end, goal_moved_m=end.distance_to(goal), took_s=time.perf_counter() - began
            )
        return super().make_plan(costmap, start, goal, footprint=footprint, keep_potential=keep_potential)

    def _plan(self, request: Request, begin: SearchStart, route: Route, began: float) -> Plan:
        points = route.points
        yaw = route.goal.yaw
        if self.params.use_final_approach_orientation and len(points) > 1:
            yaw = math.atan2(points[-1, 1] - points[-2, 1], points[-1, 0] - points[-2, 0])
        end = Pose2D(float(points[-1, 0]), float(points[-1, 1]), yaw)
        plan = super()._plan(request, begin, route._replace(goal=end, points=points[:-1]), began)
        return replace(plan, notes=() if begin.note is None else (begin.note,))
