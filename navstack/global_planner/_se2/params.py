"""Parameters that smac_hybrid and smac_lattice share, under Nav2's names."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, ClassVar, Final, Literal

from navstack.global_planner._search.start_goal import StartPolicy, unknown_not_tracked
from navstack.plugins import CheckContext, Issue, ParamModel, param

GoalHeadingMode = Literal["DEFAULT", "BIDIRECTIONAL", "ALL_DIRECTION"]
_SMOOTHER_NOTE: Final = (
    "smooth_path shortens the path by curves that keep to the turning radius; Nav2's own smoother is the smoother plugin "
    '"simple"'
)
_SMOOTHER_NAMES: Final = ("tolerance", "max_iterations", "w_data", "w_smooth", "do_refinement", "refinement_num")


class PoseSmootherParams(ParamModel):
    """The section `smoother:` of Nav2's Smac planners."""

    NO_EFFECT: ClassVar[Mapping[str, str]] = dict.fromkeys(_SMOOTHER_NAMES, _SMOOTHER_NOTE)


class PosePlannerParams(ParamModel):
    """Parameters of the planners that search over poses."""

    NO_EFFECT: ClassVar[Mapping[str, str]] = {
        "debug_visualizations": "`navstack plan` draws the swept footprint instead",
    }

    tolerance: float = param(
        0.25,
        "largest distance between the goal and the end of the path, where the goal itself cannot be reached; the turning radius "
        "times the difference in heading (rad) counts as distance",
        unit="m",
        ge=0.0,
        ros_differs="Nav2 compares it with the heuristic cost to the goal",
    )
    allow_unknown: bool = param(True, "whether paths may cross unknown cells")
    max_iterations: int = param(
        1_000_000,
        "limit on the states a search may expand, after which it fails with TIMEOUT; 0 or less = no limit. Counted, not timed, "
        "so the result is the same on every machine",
    )
    max_on_approach_iterations: int = param(
        1000,
        "expansions without progress within `tolerance` of the goal, after which the path ends at the nearest state; 0 or less = "
        "only when nothing else is left",
    )
    terminal_checking_interval: int = param(5000, "expansions between looks at the clock", ge=1)
    max_planning_time: float = param(
        0.0,
        "time limit, after which a search fails with TIMEOUT; 0 = none. With a limit, the result depends on the machine",
        unit="s",
        ge=0.0,
        ros_differs="Nav2: 5.0; here max_iterations ends a search",
    )
    cost_penalty: float = param(
        2.0, "weight of the cells' costs: crossing a cell of cost 252 costs this much more", ge=0.0, le=100.0
    )
    change_penalty: float = param(0.0, "added to non_straight_penalty where the direction of turning changes", ge=0.0)
    non_straight_penalty: float = param(1.2, "factor on the cost of turning", ge=1.0)
    reverse_penalty: float = param(2.0, "factor on the cost of driving backward", ge=1.0)
    retrospective_penalty: float = param(
        0.015, "reduction of the cost per cell, which favors states far from the start; 0 = admissible", ge=0.0, lt=1.0
    )
    cusp_penalty: float = param(
        0.0,
        "cost of a change between driving forward and backward, as much as driving this far over free cells. Above 0, states of "
        "the search have a direction of travel, and curves are chosen by their cost instead of their length",
        unit="m",
        ge=0.0,
        ros_differs="Nav2 has no such cost; with 0, as there, cars may be sent to and fro by a few centimeters",
    )
    use_quadratic_cost_penalty: bool = param(False, "whether costs count squared")
    analytic_expansion_ratio: float = param(
        3.5, "a curve to the goal is tried every (estimated cost / ratio) expansions", gt=0.0
    )
    analytic_expansion_max_length: float = param(
        3.0,
        "longest curve to the goal that is tried; 0 = only from states in its cell that are not within `tolerance`",
        unit="m",
        ge=0.0,
    )
    analytic_expansion_max_cost: float = param(
        200.0, "costs above this are allowed on a curve to the goal only in one run that ends at the goal", ge=0.0
    )
    analytic_expansion_max_cost_override: bool = param(
        False, "whether curves shorter than 2 pi times the turning radius may ignore analytic_expansion_max_cost"
    )
    cache_obstacle_heuristic: bool = param(
        False,
        "whether the heuristic is kept for the same goal although costs have changed; it is always kept while they have not",
    )
    downsample_obstacle_heuristic: bool = param(True, "whether the obstacle heuristic uses cells of twice the size")
    lookup_table_size: float = param(
        20.0,
        "side of the table of curve lengths around the goal, filled where it is needed",
        unit="m",
        gt=0.0,
        le=200.0,
    )
    goal_heading_mode: GoalHeadingMode = param(
        "DEFAULT", "headings accepted at the goal: the one given, also its opposite, or all"
    )
    coarse_search_resolution: int = param(
        1,
        "ALL_DIRECTION: curves to every n-th heading are tried first, and the others only if one of those was free",
        ge=1,
    )
    smooth_path: bool = param(
        True,
        "whether stretches of the path are replaced by cheaper curves that keep to the turning radius and are free",
        ros_differs="Nav2 smooths points, which may break the radius and collide",
    )
    start_policy: StartPolicy = param(
        "clear_footprint",
        "what to do when the start is blocked: treat its cell as free, treat all cells under the footprint as free, start from "
        "the nearest free cell, or refuse",
    )
    heuristic_weight: float = param(
        1.2,
        "factor on the heuristic: 1 = the cheapest path that the states allow; above 1 faster, at a higher cost. Above 1, "
        "long searches (8,192 states or more) go on from the goal as well, and the factor grows in searches of more than 100,000 "
        "states, up to 5",
        ge=1.0,
        le=10.0,
    )
    sections: dict[str, Any] = param({}, "Nav2's section `smoother:`, read and without effect; see smooth_path")

    CHILD_FIELD: ClassVar[str | None] = "sections"

    @classmethod
    def child_models(cls, values: Mapping[str, Any]) -> dict[str, type[ParamModel]]:
        """Return the section `smoother`."""
        del values
        return {"smoother": PoseSmootherParams}

    def check(self, context: CheckContext) -> Iterator[Issue]:
        """Yield an issue if `allow_unknown` has no effect."""
        return unknown_not_tracked(context, self.allow_unknown)
