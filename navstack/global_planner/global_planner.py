"""global_planner: navfn's successor, with a choice of expansion, potential and traceback.

Source of the method: global_planner/src/planner_core.cpp, dijkstra.cpp, quadratic_calculator.cpp, gradient_path.cpp,
grid_path.cpp (D. Lu); algorithms.md 4.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar, cast

import numpy as np
from numpy.typing import NDArray

from navstack.core import LETHAL, Costmap, Footprint, GridGeometry, Path, Pose2D
from navstack.core.parameters import ParamModel, param
from navstack.global_planner import _trace_kernels as trace
from navstack.global_planner import ends
from navstack.global_planner.cost_rule import CostRule, global_planner_rule
from navstack.global_planner.guide import CoarseGuide, astar
from navstack.global_planner.orientation_filter import OrientationMode, orient
from navstack.global_planner.replanning import GoalField, Memory, Request
from navstack.global_planner.wavefront import Guide, Wavefront
from navstack.interfaces import GlobalPlanner, Plan
from navstack.plugins import GLOBAL_PLANNERS

_PATIENCE = 8
_HAIR = 1e-9
_ENDPOINT_REACH = 2  # planner_core.cpp, clearEndpoint


class GlobalPlannerParams(ParamModel):
    """Parameters of GlobalPlanner."""

    NO_EFFECT: ClassVar[Mapping[str, str]] = {
        "planner_window_x": "read by GlobalPlanner, never used",
        "planner_window_y": "read by GlobalPlanner, never used",
        "publish_scale": "scales the potential that ROS publishes; here it comes unscaled with the plan",
    }

    old_navfn_behavior: bool = param(False, "start, goal and path points on cell corners, as navfn")
    use_quadratic: bool = param(True, "potential as a plane wave over two neighbours, instead of from the lowest one")
    use_dijkstra: bool = param(
        True,
        "Dijkstra; false = A*, which expands fewer cells",
        ros_differs="A* has the cost model of Dijkstra; in C++ it ignores cost_factor, wraps costs at 256 and mostly fails with "
        "the gradient path",
    )
    use_grid_path: bool = param(False, "path from cell to cell, instead of by gradient descent")
    allow_unknown: bool = param(True, "whether paths may cross unknown cells")
    default_tolerance: float = param(
        0.0,
        "half the side of the square around the goal in which the nearest reachable point will do",
        unit="m",
        ge=0.0,
        ros_differs="works, as in navfn; in C++ it has no effect",
    )
    outline_map: bool = param(
        True,
        "keep the outermost ring of cells blocked",
        ros_differs="C++ writes the ring into the costmap itself; here the costmap is never written to",
    )
    lethal_cost: int = param(253, "a cell of this cost less one, or more, is blocked", ge=1, le=255)
    neutral_cost: int = param(50, "cost of a free cell", ge=1, le=255)
    cost_factor: float = param(3.0, "factor on the costmap's costs", ge=0.01, le=5.0)
    publish_potential: bool = param(True, "publish the potential; here it comes with the plan on request")
    orientation_mode: int = param(
        1,
        "headings: 0 none, 1 forward, 2 interpolate, 3 forward then interpolate, 4 backward, 5 leftward, 6 rightward",
        ge=0,
        le=6,
    )
    orientation_window_size: int = param(1, "points before and after that a heading is taken from", ge=1, le=255)


@GLOBAL_PLANNERS.register("global_planner", aliases=("global_planner/GlobalPlanner",))
class GlobalPlannerROS(GlobalPlanner):
    """global_planner: a wave from the start (Dijkstra or A*, linear or quadratic), path by gradient or by grid.

    As GlobalPlanner: potential 0 at the start, whose cell counts as free; path points at cell centres, gradient paths from
    the very start to the very goal; headings by `orientation_mode`. `Plan.cost` is the potential where the plan ends:
    `neutral_cost` per free cell, up to `lethal_cost` near obstacles.

    # ROS differs: A* has Dijkstra's cost model (parity 10); every combination finds every reachable goal, in bounded time
    # (parity 11); the goal's cell is the one that holds it (parity 12); the costmap is never written to (parity 13);
    # default_tolerance works (parity 14). The seeds around the start are set in free cells only.
    """

    Params = GlobalPlannerParams

    def __init__(self, params: GlobalPlannerParams | None = None) -> None:
        super().__init__(params or GlobalPlannerParams())
        self._wave = Wavefront()
        self._coarse = CoarseGuide()
        self._field = GoalField()
        self._memory = Memory()

    def forget(self) -> None:
        """The next plan is made from scratch."""
        self._field = GoalField()
        self._memory = Memory()

    def make_plan(
        self,
        costmap: Costmap,
        start: Pose2D,
        goal: Pose2D,
        *,
        footprint: Footprint | None = None,
        keep_potential: bool = False,
    ) -> Plan:
        """A plan between two poses in the costmap's frame.

        Raises StartOutsideMapError, GoalOutsideMapError, StartOccupiedError, GoalOccupiedError, NoValidPathError, and
        InputError for a pose that is not finite. `potential` is 0 at the start.
        """
        del footprint
        params = cast("GlobalPlannerParams", self.params)
        ends.cells_of(costmap, start, goal)  # before the ring is added: outside is outside
        request = Request(start, goal, costmap.geometry, costmap.frame, keep_potential)
        known = self._memory.recall(costmap, request)
        if known is not None:
            return known
        grid = costmap if params.outline_map else _with_ring(costmap)
        rule = global_planner_rule(
            params.lethal_cost, params.neutral_cost, params.cost_factor, params.allow_unknown, params.use_quadratic
        )
        start_cell, goal_cell = ends.cells_of(grid, start, goal)
        free = [
            c
            for c in ends.goal_candidates(grid, goal, params.default_tolerance)
            if c[1] == start_cell or not ends.is_blocked(grid, rule, c[1])
        ]
        if not free:
            raise ends.goal_occupied(grid, rule, goal, goal_cell, params.default_tolerance)
        wave = self._wave
        target = free[0][1]
        gx, gy = _fractional(grid.geometry, free[0][0], target, params.old_navfn_behavior)
        first_stop = (
            math.floor(gx + _HAIR),
            math.floor(gy + _HAIR),
        )  # where C++ stops (parity 12); at most one cell before the target
        if not grid.geometry.contains_cell(*first_stop) or ends.is_blocked(grid, rule, first_stop):
            first_stop = target
        potential: NDArray[np.float32] | None = None
        guided = False

        def attempt(guide: Guide | None, limit: float) -> float:
            nonlocal potential, guided
            guided = guide is not None
            spread(wave, grid, rule, start, start_cell, first_stop, params, guide, limit)
            potential = wave.full_potential() if keep_potential else None
            if wave.potential_of(*first_stop) < math.inf:
                if not (params.use_grid_path or params.old_navfn_behavior):
                    wave.complete(target[0], target[1], _ENDPOINT_REACH)
                extend(wave, target, guide, limit)
                if guided:
                    wave.settle(target, guide, limit)
            return wave.potential_of(*target)

        rise = 2.0 * params.neutral_cost

        def first() -> object:
            if params.use_dijkstra:
                return attempt(None, math.inf)
            return astar(self._coarse, grid, rule, start_cell, target, rise, attempt)

        self._field.search(grid, rule, start_cell, target, rise, attempt, lambda: wave.expanded, first)
        reached = next((c for c in free if wave.potential_of(*c[1]) < math.inf), None)
        if reached is None:
            if wave.expanded == 0 and ends.is_blocked(grid, rule, start_cell):
                raise ends.start_occupied(grid, rule, start, start_cell)
            nearest = wave.nearest_reached(*goal_cell)
            raise ends.no_path(grid, rule, start, goal, (start_cell, goal_cell), nearest, wave.expanded)
        used, cell = reached
        cost = wave.potential_of(*cell)
        if potential is not None:
            potential[cell[1], cell[0]] = cost
            if grid is not costmap:
                potential = np.ascontiguousarray(potential[1:-1, 1:-1])
        cells = descend(wave, grid, start, start_cell, used, cell, params).astype(np.float64)
        offset = 0.0 if params.old_navfn_behavior else 0.5
        g = grid.geometry
        poses = np.zeros((len(cells) + 1, 3))
        poses[:-1, 0] = g.origin_x + (cells[::-1, 0] + offset) * g.resolution
        poses[:-1, 1] = g.origin_y + (cells[::-1, 1] + offset) * g.resolution
        poses[-1] = used
        orient(poses, start.yaw, OrientationMode(params.orientation_mode), params.orientation_window_size)
        notes: list[str] = []
        if ends.is_blocked(grid, rule, start_cell):
            notes.append("the start lies in a blocked cell, which was taken for free, as ROS does")
        moved = goal.distance_to(used)
        if moved > 0.0:
            notes.append(f"the goal cannot be reached; the plan ends {moved:.2f} m from it (default_tolerance)")
        plan = Plan(
            path=Path(poses, costmap.frame),
            cost=cost,
            goal=used,
            goal_moved_m=moved,
            cells_expanded=wave.expanded,
            potential=potential,
            notes=tuple(notes),
        )
        whole = (0, 0, costmap.geometry.nx, costmap.geometry.ny)
        # without a guide a wave looks at every cell that could matter; with one, others may come to matter
        everything = guided or params.default_tolerance > 0.0 or grid is not costmap
        self._memory.remember(costmap, request, plan, whole if everything else wave.rectangle)
        return plan


def _with_ring(costmap: Costmap) -> Costmap:
    """A copy with one more ring of lethal cells, so that the outermost cells of the map itself can be crossed."""
    g = costmap.geometry
    larger = GridGeometry(g.nx + 2, g.ny + 2, g.resolution, g.origin_x - g.resolution, g.origin_y - g.resolution)
    return Costmap(larger, np.pad(costmap.data, 1, constant_values=LETHAL), costmap.frame)


def _fractional(geometry: GridGeometry, pose: Pose2D, cell: ends.Cell, old_navfn: bool) -> tuple[float, float]:
    """Where the pose lies in cells, centres at whole numbers; the cell itself with `old_navfn`."""
    if old_navfn:
        return float(cell[0]), float(cell[1])
    return (
        (pose.x - geometry.origin_x) / geometry.resolution - 0.5,
        (pose.y - geometry.origin_y) / geometry.resolution - 0.5,
    )


def spread(
    wave: Wavefront,
    grid: Costmap,
    rule: CostRule,
    start: Pose2D,
    start_cell: ends.Cell,
    target: ends.Cell,
    params: GlobalPlannerParams,
    guide: Guide | None = None,
    limit: float = math.inf,
) -> None:
    """Runs the wave from the start until it reaches the cell `target` (DijkstraExpansion::calculatePotentials).

    Unless `old_navfn_behavior`, the four cells around the start are seeded by its distance to them.
    """
    nx, ny = grid.geometry.nx, grid.geometry.ny
    x, y = start_cell
    seeds = [(y * nx + x, 0.0)]
    fronts = [(x + 1, y), (x - 1, y), (x, y - 1), (x, y + 1)]
    if not params.old_navfn_behavior:
        fx, fy = _fractional(grid.geometry, start, start_cell, False)
        # to hundredths of a cell, as C++; before taking the cell, so that a hair's breadth does not change it
        hx, hy = math.floor(fx * 100.0 + 0.5), math.floor(fy * 100.0 + 0.5)
        ix, iy = hx // 100, hy // 100
        dx, dy = (hx % 100) / 100.0, (hy % 100) / 100.0
        square = [
            ((ix, iy), dx * dy),
            ((ix + 1, iy), (1.0 - dx) * dy),
            ((ix, iy + 1), dx * (1.0 - dy)),
            ((ix + 1, iy + 1), (1.0 - dx) * (1.0 - dy)),
        ]
        around = [
            ((ix + 2, iy), (ix + 1, iy)),
            ((ix - 1, iy), (ix, iy)),
            ((ix - 1, iy + 1), (ix, iy + 1)),
            ((ix + 2, iy + 1), (ix + 1, iy + 1)),
            ((ix, iy - 1), (ix, iy)),
            ((ix + 1, iy - 1), (ix + 1, iy)),
            ((ix, iy + 2), (ix, iy + 1)),
            ((ix + 1, iy + 2), (ix + 1, iy + 1)),
        ]
        open_ = {
            c
            for c, _ in square
            if c == start_cell or (0 <= c[0] < nx and 0 <= c[1] < ny and not ends.is_blocked(grid, rule, c))
        }
        if len(open_) == len(square):
            seeds = [(c[1] * nx + c[0], params.neutral_cost * 2.0 * w) for c, w in square]
            fronts = [outer for outer, inner in around if inner in open_]
        # ROS differs: beside an obstacle the start's own cell is the only seed; C++ seeds through the obstacle
    wave.begin(
        grid,
        rule,
        seeds=seeds,
        fronts=fronts,
        target=target,
        threshold=float(params.lethal_cost),
        rise=2.0 * params.neutral_cost,
    )
    extend(wave, target, guide, limit)


def extend(wave: Wavefront, target: ends.Cell, guide: Guide | None = None, limit: float = math.inf) -> None:
    """Lets the wave run on until it reaches the cell `target`, if it has not yet."""
    if wave.potential_of(*target) == math.inf:
        wave.run(target[1] * wave.nx + target[0], guide=guide, limit=limit)


def descend(
    wave: Wavefront,
    grid: Costmap,
    start: Pose2D,
    start_cell: ends.Cell,
    goal: Pose2D,
    goal_cell: ends.Cell,
    params: GlobalPlannerParams,
) -> NDArray[np.float32]:
    """The path (n, 2) of cells, with fractions, from the goal to the start (GradientPath, GridPath)."""
    nx = wave.nx
    k = goal_cell[1] * nx + goal_cell[0]
    gx, gy = _fractional(grid.geometry, goal, goal_cell, params.old_navfn_behavior)
    if params.use_grid_path:
        # ROS differs: under A* the cheapest neighbour, not the lowest; C++'s A* gives cheaper grid paths than its Dijkstra
        rule = wave.rule
        points, n = trace.grid_path(wave.pot, nx, wave.ny, k, gx, gy, wave.cost, rule.steps, not params.use_dijkstra)
        cells = points[:n]
        if len(cells) > 1 and (cells[-1] != start_cell).any():  # another of the four seeds
            cells = np.vstack([cells, np.array([start_cell], np.float32)])
        return cells
    sx, sy = _fractional(grid.geometry, start, start_cell, params.old_navfn_behavior)
    ix, iy = math.floor(gx + _HAIR), math.floor(gy + _HAIR)
    if wave.potential_of(ix, iy) < math.inf:  # C++ starts there, or fails (parity 12)
        k = iy * nx + ix
    else:
        ix, iy = goal_cell
        gx, gy = float(ix), float(iy)
    points, n = trace.gradient_path(
        wave.pot,
        nx,
        wave.ny,
        k,
        np.float32(gx - ix),
        np.float32(gy - iy),
        np.float32(sx),
        np.float32(sy),
        np.float32(-1.0),
        np.float32(0.5),
        _PATIENCE,
    )
    return points[:n]
