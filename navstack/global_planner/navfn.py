"""navfn: the planner that move_base runs by default.

Source of the method: navfn/src/navfn.cpp and navfn_ros.cpp (K. Konolige); algorithms.md 3.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import ClassVar, cast

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, Pose2D
from navstack.core.parameter_checks import CheckContext, Issue
from navstack.core.parameters import param
from navstack.global_planner import _trace_kernels as trace
from navstack.global_planner import ends
from navstack.global_planner.cost_rule import NAVFN_NEUTRAL, CostRule, navfn_rule
from navstack.global_planner.loops import without_loops
from navstack.global_planner.parameter_checks import unknown_not_tracked
from navstack.global_planner.search_params import SearchParams
from navstack.global_planner.wave_planner import WavePlanner, WaveQuery
from navstack.global_planner.wavefront import Guide, Wavefront
from navstack.plugins import GLOBAL_PLANNERS

_FIRST_THRESHOLD = 254.0  # navfn.h, COST_OBS
RISE = 2.0 * NAVFN_NEUTRAL  # navfn.cpp, priInc
_PATIENCE = 40  # C++ bounces for up to 20 points and then comes through: as it does


class NavfnParams(SearchParams):
    """Parameters of NavfnROS, and ours."""

    NO_EFFECT: ClassVar[Mapping[str, str]] = {
        "planner_window_x": "read by NavfnROS, never used",
        "planner_window_y": "read by NavfnROS, never used",
    }

    allow_unknown: bool = param(True, "whether paths may cross unknown cells (at the cost of 253)")
    visualize_potential: bool = param(False, "keep the potential in every plan, to be drawn")
    use_astar: bool = param(
        False,
        "A* instead of Dijkstra: fewer cells for a path of the same cost (within 1 %)",
        ros_differs="C++ navfn has an A* that NavfnROS cannot reach; it gives paths up to 20 % costlier and fails on large maps",
    )

    def check(self, context: CheckContext) -> Iterator[Issue]:
        """Yield whether `allow_unknown` has an effect."""
        return unknown_not_tracked(context, self.allow_unknown)


def spread(
    wave: Wavefront,
    costmap: Costmap,
    rule: CostRule,
    *,
    root: ends.Cell,
    target: ends.Cell,
    stop: bool = True,
    guide: Guide | None = None,
    limit: float = math.inf,
) -> None:
    """Runs the wave from cell `root` until it reaches `target`, with `stop` false over everything (calcNavFnDijkstra)."""
    x, y = root
    nx = costmap.data.shape[1]
    wave.begin(
        costmap,
        rule,
        seeds=[(y * nx + x, 0.0)],
        fronts=[(x + 1, y), (x - 1, y), (x, y - 1), (x, y + 1)],
        target=target,
        threshold=_FIRST_THRESHOLD,
        rise=RISE,
    )
    wave.run(target[1] * nx + target[0] if stop else -1, guide=guide, limit=limit)


def descend(wave: Wavefront, cell: ends.Cell, *, root: ends.Cell) -> NDArray[np.float32]:
    """The path (n, 2) of cells, with fractions, from `cell` down to the root of navfn's wave (calcPath)."""
    points, n = trace.gradient_path(
        wave.pot,
        wave.nx,
        wave.ny,
        cell[1] * wave.nx + cell[0],
        np.float32(0.0),
        np.float32(0.0),
        np.float32(root[0]),
        np.float32(root[1]),
        np.float32(NAVFN_NEUTRAL),
        np.float32(-1.0),
        _PATIENCE,
    )
    return points[:n]


@GLOBAL_PLANNERS.register("navfn", aliases=("navfn/NavfnROS",))
class NavfnROS(WavePlanner):
    """navfn: Dijkstra's wavefront from the start, gradient descent from the goal.

    As NavfnROS: the outermost ring of cells is blocked; the start's own cell counts as free; path points lie on cell
    corners with yaw 0 and are followed by the goal pose; with `default_tolerance` the nearest reachable point of a lattice
    around the goal will do. `Plan.cost` is the potential where the plan ends: 50 per free cell, up to 253 near obstacles.

    # ROS differs: no cap on rounds, on cells waiting, or on path points (parity 4, 5, 6); A* is right (parity 7); the
    # costmap is never written to (C++ frees the start's cell in it).
    """

    Params = NavfnParams

    def __init__(self, params: NavfnParams | None = None) -> None:
        super().__init__(params or NavfnParams())

    def _rule(self) -> CostRule:
        return navfn_rule(cast("NavfnParams", self.params).allow_unknown)

    def _rise(self) -> float:
        return RISE

    def _is_guided(self) -> bool:
        return cast("NavfnParams", self.params).use_astar

    def _run(self, query: WaveQuery, guide: Guide | None, limit: float, keep: bool) -> NDArray[np.float32] | None:
        wave, target = self._wave, query.goal_cell
        spread(wave, query.grid, query.rule_for(guide), root=query.start_cell, target=target, guide=guide, limit=limit)
        if guide is not None:
            wave.settle(target, guide, limit)
        keep = keep or cast("NavfnParams", self.params).visualize_potential
        return wave.full_potential() if keep else None

    def _descend(self, query: WaveQuery, goal: Pose2D, cell: ends.Cell, loops: bool) -> NDArray[np.float64]:
        del goal
        g = query.grid.geometry
        cells = descend(self._wave, cell, root=query.start_cell)
        cells = (cells if loops else without_loops(cells, g.nx)).astype(np.float64)
        return cells[::-1] * g.resolution + (g.origin_x, g.origin_y)
