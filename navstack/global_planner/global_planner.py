"""global_planner: the successor of navfn, with a choice of expansion, potential and traceback.

Source: global_planner/src/planner_core.cpp, dijkstra.cpp, quadratic_calculator.cpp, gradient_path.cpp, grid_path.cpp
(D. Lu); algorithms.md 4.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

from navstack.global_planner._search.base import SearchParams, SearchPlanner
from navstack.global_planner._search.cells import global_planner_costs
from navstack.global_planner._search.orientation_filter import OrientationFilter, OrientationMode
from navstack.global_planner._search.propagation import SubcellPropagation
from navstack.global_planner._search.start_goal import unknown_not_tracked
from navstack.global_planner._search.traceback import GradientTraceback, GridTraceback, Traceback
from navstack.global_planner._search.wave_search import WaveSearch
from navstack.plugins import GLOBAL_PLANNERS, CheckContext, Issue, param


class GlobalPlannerParams(SearchParams):
    """Parameters of GlobalPlanner."""

    NO_EFFECT: ClassVar[Mapping[str, str]] = {
        "planner_window_x": "read by GlobalPlanner, never used",
        "planner_window_y": "read by GlobalPlanner, never used",
    }

    CLAMPED: ClassVar[frozenset[str]] = frozenset(
        {"lethal_cost", "neutral_cost", "cost_factor", "orientation_mode", "orientation_window_size"}
    )
    old_navfn_behavior: bool = param(False, "start, goal and path points on cell corners, as in navfn")
    use_quadratic: bool = param(
        True, "potential of a plane wave over two neighbors, instead of from the lowest neighbor"
    )
    use_dijkstra: bool = param(
        True,
        "Dijkstra; false = A*, which expands fewer cells",
        ros_differs="A* has the cost model of Dijkstra; in C++ it ignores cost_factor, wraps costs at 256 and usually fails "
        "with the gradient path",
    )
    use_grid_path: bool = param(False, "path from cell to cell, instead of by gradient descent")
    allow_unknown: bool = param(True, "whether paths may cross unknown cells")
    default_tolerance: float = param(
        0.0,
        "half the side of the square around the goal; if the goal is unreachable, the plan ends at the nearest reachable point "
        "in it",
        unit="m",
        ge=0.0,
        ros_differs="has the same effect as in navfn; in C++ it has none",
    )
    outline_map: bool = param(
        True,
        "treat the outermost ring of cells as blocked",
        ros_differs="C++ writes the ring into the costmap; here the costmap is never written to",
    )
    lethal_cost: int = param(253, "cells with a cost of at least this value less one are blocked", ge=1, le=255)
    neutral_cost: int = param(50, "cost of a free cell", ge=1, le=255)
    cost_factor: float = param(3.0, "factor on the costmap's costs", ge=0.01, le=5.0)
    publish_potential: bool = param(True, "publish the potential (ROS 1 node); elsewhere plans contain it on request")
    publish_scale: int = param(100, "value of the largest potential that is published (ROS 1 node)", ge=1, le=127)
    orientation_mode: int = param(
        1,
        "headings: 0 none, 1 forward, 2 interpolate, 3 forward then interpolate, 4 backward, 5 leftward, 6 rightward",
        ge=0,
        le=6,
    )
    orientation_window_size: int = param(
        1, "number of points before and after a point from which its heading is computed", ge=1, le=255
    )

    def check(self, context: CheckContext) -> Iterator[Issue]:
        """Yield an issue if `allow_unknown` has no effect."""
        return unknown_not_tracked(context, self.allow_unknown)


@GLOBAL_PLANNERS.register("global_planner", aliases=("global_planner/GlobalPlanner",))
class GlobalPlannerROS(SearchPlanner):
    """global_planner: a wave from the start (Dijkstra or A*, linear or quadratic), path by gradient or by grid.

    As in GlobalPlanner, the potential is 0 at the start, whose cell counts as free; the path's points are cell centers, or
    for gradient paths continuous from the exact start to the exact goal; headings are set by `orientation_mode`.
    `Plan.cost` is the potential at the end of the plan: `neutral_cost` per free cell, up to `lethal_cost` near obstacles.

    # ROS differs: A* has the cost model of Dijkstra (parity 10); every combination finds every reachable goal, in bounded
    # time (parity 11); the goal cell is the cell that contains the goal (parity 12); the costmap is never written to (parity
    # 13); default_tolerance has an effect (parity 14). Seeds around the start are set in free cells only.
    """

    Params = GlobalPlannerParams

    def __init__(self, params: GlobalPlannerParams | None = None) -> None:
        p = params or GlobalPlannerParams()
        search = WaveSearch(
            global_planner_costs(p.lethal_cost, p.neutral_cost, p.cost_factor, p.allow_unknown, p.use_quadratic),
            SubcellPropagation(
                threshold=float(p.lethal_cost),
                neutral=p.neutral_cost,
                at_cells=p.old_navfn_behavior,
                complete_goal=not (p.use_grid_path or p.old_navfn_behavior),
            ),
            _traceback(p),
            use_astar=not p.use_dijkstra,
            border_blocked=p.outline_map,
            max_expanded=p.expansion_limit,
        )
        orientation = OrientationFilter(OrientationMode(p.orientation_mode), p.orientation_window_size)
        super().__init__(p, search, orientation)


def _traceback(p: GlobalPlannerParams) -> Traceback:
    if p.use_grid_path:
        return GridTraceback(at_cells=p.old_navfn_behavior, cheapest=not p.use_dijkstra)
    return GradientTraceback(at_cells=p.old_navfn_behavior)
