"""navfn: the default global planner of move_base.

Source: navfn/src/navfn.cpp and navfn_ros.cpp (K. Konolige); algorithms.md 3.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

from navstack.global_planner._search.base import SearchParams, SearchPlanner
from navstack.global_planner._search.cells import navfn_costs
from navstack.global_planner._search.propagation import NavfnPropagation
from navstack.global_planner._search.start_goal import unknown_not_tracked
from navstack.global_planner._search.traceback import NavfnTraceback
from navstack.global_planner._search.wave_search import WaveSearch
from navstack.plugins import GLOBAL_PLANNERS, CheckContext, Issue, param


class NavfnParams(SearchParams):
    """Parameters of NavfnROS, and additional ones."""

    NO_EFFECT: ClassVar[Mapping[str, str]] = {
        "planner_window_x": "read by NavfnROS, never used",
        "planner_window_y": "read by NavfnROS, never used",
    }

    allow_unknown: bool = param(True, "whether paths may cross unknown cells, at cost 253")
    visualize_potential: bool = param(False, "return the potential with every plan, for visualization")
    use_astar: bool = param(
        False,
        "A* instead of Dijkstra: expands fewer cells for a path of the same cost (within 1 %)",
        ros_differs="C++ navfn has an A* that NavfnROS cannot use; its paths cost up to 20 % more and it fails on large maps",
    )

    def check(self, context: CheckContext) -> Iterator[Issue]:
        """Yield an issue if `allow_unknown` has no effect."""
        return unknown_not_tracked(context, self.allow_unknown)


@GLOBAL_PLANNERS.register("navfn", aliases=("navfn/NavfnROS",))
class NavfnROS(SearchPlanner):
    """navfn: a Dijkstra wavefront from the start and gradient descent from the goal.

    As in NavfnROS, the outermost ring of cells is blocked, the start cell counts as free, and the path's points are on cell
    corners with yaw 0, followed by the goal pose. With `default_tolerance` the plan may end at the nearest reachable point
    of a lattice around the goal. `Plan.cost` is the potential at the end of the plan: 50 per free cell, up to 253 near
    obstacles.

    # ROS differs: there is no limit on rounds, queued cells or path points (parity 4, 5, 6); A* is correct (parity 7); the
    # costmap is never written to (C++ frees the start cell in it).
    """

    Params = NavfnParams

    def __init__(self, params: NavfnParams | None = None) -> None:
        p = params or NavfnParams()
        search = WaveSearch(
            navfn_costs(p.allow_unknown),
            NavfnPropagation(),
            NavfnTraceback(),
            use_astar=p.use_astar,
            max_expanded=p.expansion_limit,
            keep_potential=p.visualize_potential,
        )
        super().__init__(p, search)
