"""global_planner: navfn's successor, with a choice of expansion, potential and traceback.

Source of the method: global_planner/src/planner_core.cpp, dijkstra.cpp, quadratic_calculator.cpp, gradient_path.cpp,
grid_path.cpp (D. Lu); algorithms.md 4.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import ClassVar, cast

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, GridGeometry, Pose2D
from navstack.core.parameter_checks import CheckContext, Issue
from navstack.core.parameters import param
from navstack.global_planner import _trace_kernels as trace
from navstack.global_planner import ends
from navstack.global_planner.cost_rule import CostRule, global_planner_rule
from navstack.global_planner.loops import without_loops
from navstack.global_planner.orientation_filter import OrientationMode, orient
from navstack.global_planner.parameter_checks import unknown_not_tracked
from navstack.global_planner.search_params import SearchParams
from navstack.global_planner.wave_planner import WavePlanner, WaveQuery
from navstack.global_planner.wavefront import Guide, Wavefront
from navstack.plugins import GLOBAL_PLANNERS

_PATIENCE = 8
_HAIR = 1e-9
_ENDPOINT_REACH = 2  # planner_core.cpp, clearEndpoint


class GlobalPlannerParams(SearchParams):
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

    def check(self, context: CheckContext) -> Iterator[Issue]:
        """Yield whether `allow_unknown` has an effect."""
        return unknown_not_tracked(context, self.allow_unknown)


@GLOBAL_PLANNERS.register("global_planner", aliases=("global_planner/GlobalPlanner",))
class GlobalPlannerROS(WavePlanner):
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

    @property
    def _own(self) -> GlobalPlannerParams:
        return cast("GlobalPlannerParams", self.params)

    def _rule(self) -> CostRule:
        p = self._own
        return global_planner_rule(p.lethal_cost, p.neutral_cost, p.cost_factor, p.allow_unknown, p.use_quadratic)

    def _rise(self) -> float:
        return 2.0 * self._own.neutral_cost

    def _is_guided(self) -> bool:
        return not self._own.use_dijkstra

    def _blocks_outline(self) -> bool:
        return self._own.outline_map

    def _run(self, query: WaveQuery, guide: Guide | None, limit: float, keep: bool) -> NDArray[np.float32] | None:
        wave, params, target = self._wave, self._own, query.goal_cell
        gx, gy = _fractional(query.grid.geometry, query.goal, target, params.old_navfn_behavior)
        # where C++ stops (parity 12); at most one cell before the target
        stop = math.floor(gx + _HAIR), math.floor(gy + _HAIR)
        if not query.grid.geometry.contains_cell(*stop) or ends.is_blocked(query.grid, query.rule, stop):
            stop = target
        spread(wave, query.grid, query.rule_for(guide), query.start, query.start_cell, stop, params, guide, limit)
        potential = wave.full_potential() if keep else None
        if wave.potential_of(*stop) < math.inf:
            gradient = not (params.use_grid_path or params.old_navfn_behavior)
            if guide is None:  # as C++, to the bit
                if gradient:
                    wave.complete(target[0], target[1], _ENDPOINT_REACH)
                extend(wave, target)
            else:  # what is completed is not queued: a wave that runs on would not lower what lies behind it
                extend(wave, target, guide, limit)
                wave.settle(target, guide, limit)
                if gradient:
                    wave.complete(target[0], target[1], _ENDPOINT_REACH)
        return potential

    def _descend(self, query: WaveQuery, goal: Pose2D, cell: ends.Cell, loops: bool) -> NDArray[np.float64]:
        g = query.grid.geometry
        cells = descend(self._wave, query.grid, query.start, query.start_cell, goal, cell, self._own)
        cells = cells if loops else without_loops(cells, g.nx)
        offset = 0.0 if self._own.old_navfn_behavior else 0.5
        return (cells[::-1].astype(np.float64) + offset) * g.resolution + (g.origin_x, g.origin_y)

    def _orient(self, poses: NDArray[np.float64], start_yaw: float) -> None:
        orient(poses, start_yaw, OrientationMode(self._own.orientation_mode), self._own.orientation_window_size)


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
