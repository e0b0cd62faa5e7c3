"""A planner composed of the parts of others, as a plugin author writes it."""

from __future__ import annotations

import numpy as np
import pytest

from navstack.core import Costmap, GridGeometry, NoValidPathError, Pose2D
from navstack.global_planner import (
    GridTraceback,
    Query,
    Route,
    Search,
    SearchParams,
    SearchPlanner,
    SubcellPropagation,
    Unreachable,
    WaveSearch,
    wave_costs,
)


class ShortestPath(SearchPlanner):
    """The shortest 4-connected path, regardless of the costs of free cells."""

    Params = SearchParams

    def __init__(self, params: SearchParams | None = None) -> None:
        p = params or SearchParams()
        blocked = np.arange(256) >= 253
        search = WaveSearch(
            wave_costs(np.full(256, 10.0, np.float32), blocked, quadratic=False, allow_unknown=False),
            SubcellPropagation(threshold=20.0, neutral=10.0, at_cells=True, complete_goal=False),
            GridTraceback(at_cells=False, cheapest=False),
            border_blocked=False,
            max_expanded=p.expansion_limit,
        )
        super().__init__(p, search)


class StraightLine(Search):
    """A search that connects start and goal directly if the straight line is free."""

    def __init__(self) -> None:
        super().__init__(wave_costs(np.ones(256, np.float32), np.arange(256) >= 253), border_blocked=False)

    def find(self, query: Query, goal_cell: tuple[int, int]) -> Route | Unreachable:
        goal = query.goals[0][0]
        points = np.linspace(query.start[:2], goal[:2], 50, endpoint=False)
        costs = [query.space.costmap.cost_at(x, y) for x, y in points]
        if any(cost is None or self.costs.blocked[cost] for cost in costs):
            return Unreachable(query.start_cell, 0, is_exhausted=False, left_start=True)
        return Route(goal, query.start.distance_to(goal), points, 0, None, None)

    def reset(self) -> None:
        pass


def corridor() -> Costmap:
    data = np.zeros((20, 30), np.uint8)
    data[10, :25] = 254
    data[:10, 5:] += 200
    return Costmap(GridGeometry(30, 20, 0.1), data)


def test_wave_search() -> None:
    costmap = corridor()
    plan = ShortestPath().make_plan(costmap, Pose2D(0.25, 0.25), Pose2D(0.25, 1.85))
    # 23 cells to the right, 16 up, and back
    assert plan.cost == pytest.approx(10.0 * (23 + 16 + 23))
    assert all(costmap.cost_at(x, y) != 254 for x, y, _ in plan.path.poses)
    tolerant = ShortestPath(SearchParams(default_tolerance=0.25, start_policy="nearest_free"))
    assert tolerant.make_plan(costmap, Pose2D(0.25, 1.05), Pose2D(2.85, 0.25)).notes


def test_own_search() -> None:
    costmap = corridor()
    planner = SearchPlanner(SearchParams(), StraightLine())
    plan = planner.make_plan(costmap, Pose2D(0.25, 0.25), Pose2D(2.85, 0.85, 1.0))
    assert plan.length_m == pytest.approx(plan.cost)
    assert planner.make_plan(costmap, Pose2D(0.25, 0.25), Pose2D(2.85, 0.85, 1.0)) is plan
    with pytest.raises(NoValidPathError, match="no path connects"):
        planner.make_plan(costmap, Pose2D(0.25, 0.25), Pose2D(0.25, 1.85))
