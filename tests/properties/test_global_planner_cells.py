"""astar and theta_star on random grids with every cost value, compared with an independent Dijkstra."""

from __future__ import annotations

import math
from heapq import heappop, heappush
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from navstack.core import Costmap, GoalOccupiedError, NoValidPathError, Pose2D, StartOccupiedError
from navstack.global_planner import AStarParams, AStarPlanner, ThetaStarParams, ThetaStarPlanner
from navstack.plugins import GlobalPlanner, Plan
from tests.properties.test_global_planner import RESOLUTION, problems

Cell = tuple[int, int]


def cells_of(problem: tuple[Costmap, Pose2D, Pose2D]) -> tuple[Cell, Cell]:
    costmap, start, goal = problem
    s, t = costmap.geometry.world_to_cell(start.x, start.y), costmap.geometry.world_to_cell(goal.x, goal.y)
    assert s is not None
    assert t is not None
    return s, t


def weights_of(costmap: Costmap, neutral: float, factor: float, unknown: bool) -> NDArray[np.float64]:
    """Cost of a unit of length in each cell, inf where blocked."""
    data = costmap.data.astype(float)
    out = neutral + factor * np.minimum(data, 252.0)
    out[(costmap.data == 253) | (costmap.data == 254) | ((costmap.data == 255) & (not unknown))] = math.inf
    return out


def dijkstra(weights: NDArray[np.float64], s: Cell, t: Cell, neutral: float, cut: bool) -> float:
    ny, nx = weights.shape

    def weight(x: int, y: int) -> float:
        if not (0 <= x < nx and 0 <= y < ny):
            return math.inf
        return neutral if (x, y) == s and math.isinf(weights[y, x]) else float(weights[y, x])

    best, heap = {s: 0.0}, [(0.0, s)]
    while heap:
        cost, (x, y) = heappop(heap)
        if (x, y) == t:
            return cost
        if cost > best[x, y]:
            continue
        for dx in (-1, 0, 1):
            for dy in (-1, 0, 1):
                n = x + dx, y + dy
                if (dx, dy) == (0, 0) or math.isinf(weight(*n)):
                    continue
                if dx and dy:
                    walls = sum(math.isinf(weights[b, a]) for a, b in ((x + dx, y), (x, y + dy)))
                    if walls > (1 if cut else 0):
                        continue
                c = cost + math.hypot(dx, dy) * 0.5 * (weight(x, y) + weight(*n))
                if c < best.get(n, math.inf):
                    best[n] = c
                    heappush(heap, (c, n))
    return math.inf


def plan_or_error(planner: GlobalPlanner, problem: tuple[Costmap, Pose2D, Pose2D], best: float) -> Plan | None:
    """The plan if Dijkstra finds one; None if neither does."""
    costmap, start, goal = problem
    s, t = cells_of(problem)
    before = costmap.data.copy()
    try:
        plan = planner.make_plan(costmap, start, goal, keep_potential=True)
    except (GoalOccupiedError, StartOccupiedError, NoValidPathError):
        assert math.isinf(best)
        return None
    finally:
        assert (costmap.data == before).all()
    assert s == t or math.isfinite(best)
    assert tuple(plan.path.poses[0])[:2] == tuple(start)[:2]
    assert tuple(plan.path.poses[-1]) == tuple(goal)
    return plan


@pytest.mark.slow
@settings(deadline=None, max_examples=60)
@given(
    problem=problems(),
    neutral=st.sampled_from([1.0, 50.0]),
    factor=st.sampled_from([0.0, 0.8, 5.0]),
    unknown=st.booleans(),
    cut=st.booleans(),
    heuristic=st.sampled_from([0.0, 0.5, 1.0, 1.5, 3.0]),
)
def test_astar_costs_what_dijkstra_does(
    problem: tuple[Costmap, Pose2D, Pose2D], neutral: float, factor: float, unknown: bool, cut: bool, heuristic: float
) -> None:
    s, t = cells_of(problem)
    weights = weights_of(problem[0], neutral, factor, unknown)
    best = dijkstra(weights, s, t, neutral, cut)
    params = AStarParams(
        neutral_cost=neutral, cost_factor=factor, allow_unknown=unknown, cut_corners=cut, heuristic_weight=heuristic
    )
    plan = plan_or_error(AStarPlanner(params), problem, best)
    if plan is None or s == t:
        return
    assert best * (1.0 - 1e-9) <= plan.cost <= best * max(1.0, heuristic) * (1.0 + 1e-9)
    assert plan.potential is not None
    assert plan.potential[s[1], s[0]] == 0.0
    assert plan.potential[t[1], t[0]] == np.float32(plan.cost)
    g = problem[0].geometry
    for a, b in zip(plan.path.poses[:-1], plan.path.poses[1:], strict=True):
        for q in np.linspace(0.0, 1.0, 11):
            x, y = g.world_to_cell_unbounded(*(a + q * (b - a))[:2])
            on_edge = np.abs(((a + q * (b - a))[:2] - (g.origin_x, g.origin_y)) / RESOLUTION % 1.0).min() < 1e-6
            assert on_edge or (x, y) == s or math.isfinite(weights[y, x])


@pytest.mark.slow
@settings(deadline=None, max_examples=60)
@given(problem=problems(), factor=st.sampled_from([0.0, 0.8]), unknown=st.booleans(), cut=st.booleans())
def test_theta_star_is_legal_and_never_more_expensive(
    problem: tuple[Costmap, Pose2D, Pose2D], factor: float, unknown: bool, cut: bool
) -> None:
    s, t = cells_of(problem)
    weights = weights_of(problem[0], 50.0, factor, unknown)
    best = dijkstra(weights, s, t, 50.0, cut)
    params = ThetaStarParams(cost_factor=factor, allow_unknown=unknown, cut_corners=cut)
    plan = plan_or_error(ThetaStarPlanner(params), problem, best)
    if plan is None or s == t:
        return
    assert plan.cost <= best * (1.0 + 1e-9)
    g = problem[0].geometry
    straight = 50.0 * math.hypot(s[0] - t[0], s[1] - t[1])
    assert plan.cost >= straight * (1.0 - 1e-9)
    inner = (plan.path.poses[1:-1, :2] - (g.origin_x, g.origin_y)) / RESOLUTION
    integral = 0.0
    for a, b in pairwise([np.array(s) + 0.5, *inner, np.array(t) + 0.5]):
        length = float(np.hypot(*(b - a)))
        assert length <= math.sqrt(2.0) + 1e-9
        for q in (np.arange(200) + 0.5) / 200.0:
            p = a + q * (b - a)
            if np.abs(p - np.rint(p)).min() < 1e-6:
                continue  # on the edge between two cells
            x, y = int(p[0]), int(p[1])
            w = 50.0 if (x, y) == s and math.isinf(weights[y, x]) else float(weights[y, x])
            assert math.isfinite(w)
            integral += w * length / 200.0
    diagonal_edges = 0.03 * best + 60.0  # not covered by the samples
    assert integral == pytest.approx(plan.cost, abs=diagonal_edges) or len(inner) < 3
