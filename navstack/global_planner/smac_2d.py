"""smac_2d: the parameters of Nav2's SmacPlanner2D, planned by A* over cells as `astar` does."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cache
from typing import Any, ClassVar, Final

import numpy as np

from navstack.core import Path
from navstack.global_planner._search.base import Route, SearchPlanner
from navstack.global_planner._search.best_first import UNLIMITED
from navstack.global_planner._search.cell_search import CellSearch, octile_expansion
from navstack.global_planner._search.cells import CellCosts, cell_costs
from navstack.global_planner._search.orientation_filter import OrientationFilter, OrientationMode
from navstack.global_planner._search.plan_cache import Request
from navstack.global_planner._search.start_goal import SearchStart, StartPolicy, unknown_not_tracked
from navstack.plugins import GLOBAL_PLANNERS, CheckContext, Issue, ParamModel, Plan, param

_SMOOTHER_NOTE: Final = 'Nav2\'s smoother is the smoother plugin "simple" (base_smoother: simple)'
_SMOOTHER_NAMES: Final = ("tolerance", "max_iterations", "w_data", "w_smooth", "do_refinement", "refinement_num")


class Smac2DSmootherParams(ParamModel):
    """The section `smoother:` of Nav2's planner."""

    NO_EFFECT: ClassVar[Mapping[str, str]] = dict.fromkeys(_SMOOTHER_NAMES, _SMOOTHER_NOTE)


class Smac2DParams(ParamModel):
    """Parameters of smac_2d, under Nav2's names."""

    NO_EFFECT: ClassVar[Mapping[str, str]] = {
        "max_on_approach_iterations": "the search expands all that is reachable before it accepts a point within tolerance",
        "terminal_checking_interval": "max_iterations ends a search, on every machine alike",
        "max_planning_time": "max_iterations ends a search, on every machine alike",
        "downsample_costmap": "the search uses the cells of the costmap; a coarser costmap is set by its resolution",
        "downsampling_factor": "the search uses the cells of the costmap; a coarser costmap is set by its resolution",
        "smooth_path": _SMOOTHER_NOTE,
        "debug_visualizations": "`navstack plan` draws the path instead",
    }

    tolerance: float = param(
        0.125,
        "half the side of the square around the goal; if the goal is unreachable, the plan ends at the nearest reachable point "
        "in it",
        unit="m",
        ge=0.0,
        ros_differs="Nav2: a distance",
    )
    allow_unknown: bool = param(True, "whether paths may cross unknown cells")
    max_iterations: int = param(
        1_000_000, "limit on the cells a search may expand, after which it fails with TIMEOUT; 0 or less = no limit"
    )
    cost_travel_multiplier: float = param(
        1.0, "weight of the cells' costs: crossing a cell of cost 252 costs this much more", ge=0.0, le=1e4
    )
    use_quadratic_cost_penalty: bool = param(False, "whether costs count squared")
    use_final_approach_orientation: bool = param(
        False, "whether the heading at the end is that of the last step, not the goal's"
    )
    start_policy: StartPolicy = param(
        "clear_footprint",
        "what to do when the start is blocked: treat its cell as free, treat all cells under the footprint as free, start from "
        "the nearest free cell, or refuse",
    )
    sections: dict[str, Any] = param({}, "Nav2's section `smoother:`, read and without effect")

    CHILD_FIELD: ClassVar[str | None] = "sections"

    @classmethod
    def child_models(cls, values: Mapping[str, Any]) -> dict[str, type[ParamModel]]:
        """Return the section `smoother`."""
        del values
        return {"smoother": Smac2DSmootherParams}

    @property
    def default_tolerance(self) -> float:
        """`tolerance`, as the other planners call it."""
        return self.tolerance

    @property
    def expansion_limit(self) -> int:
        """`max_iterations`, with a large number for no limit."""
        return self.max_iterations if self.max_iterations > 0 else UNLIMITED

    def check(self, context: CheckContext) -> Iterator[Issue]:
        """Yield an issue if `allow_unknown` has no effect."""
        return unknown_not_tracked(context, self.allow_unknown)


@GLOBAL_PLANNERS.register("smac_2d", aliases=("nav2_smac_planner/SmacPlanner2D", "smac_planner_2d"))
class Smac2DPlanner(SearchPlanner):
    """smac_2d: the cheapest path over the 8 neighbors, for YAML of Nav2's SmacPlanner2D.

    A step costs its length in cells times 1 + cost_travel_multiplier · c / 252, half in each of its cells. Otherwise as `astar`:
    the path runs through the centers of cells and does not pass between two blocked ones; a smoother is a plugin of its own.
    """

    Params = Smac2DParams
    NAMESPACES: ClassVar[tuple[str, ...]] = ("GridBased",)
    params: Smac2DParams
    limit_name = "max_iterations"
    tolerance_name = "tolerance"

    def __init__(self, params: Smac2DParams | None = None) -> None:
        p = params or Smac2DParams()
        costs = _costs(p.allow_unknown, p.cost_travel_multiplier, p.use_quadratic_cost_penalty)
        search = CellSearch(costs, octile_expansion, max_expanded=p.expansion_limit)
        headings = OrientationFilter(OrientationMode.FORWARD, sets_start=True)
        super().__init__(p, search, headings)  # pyright: ignore[reportArgumentType]

    def _plan(self, request: Request, begin: SearchStart, route: Route, began: float) -> Plan:
        plan = super()._plan(request, begin, route, began)
        poses = plan.path.poses
        if not self.params.use_final_approach_orientation or len(poses) < 2:
            return plan
        poses = poses.copy()
        poses[-1, 2] = np.arctan2(*(poses[-1, :2] - poses[-2, :2])[::-1])
        path = Path(poses, plan.path.frame)
        return replace(plan, path=path, goal=path[-1])


@cache
def _costs(allow_unknown: bool, multiplier: float, quadratic: bool) -> CellCosts:
    linear = cell_costs(allow_unknown, 1.0, multiplier / 252.0)
    if not quadratic:
        return linear
    share = np.minimum(np.arange(256), 252) / 252.0
    weights = np.where(linear.blocked, np.inf, 1.0 + multiplier * share**2)
    weights.setflags(write=False)
    return CellCosts(linear.blocked, allow_unknown, weights, 1.0)
