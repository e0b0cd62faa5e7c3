"""Random grids with every cost value: a legal path with the correct cost, or the correct exception; no writes to the costmap."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.ndimage import label

from navstack.core import Costmap, GoalOccupiedError, GridGeometry, NoValidPathError, Pose2D, StartOccupiedError
from navstack.global_planner import (
    GlobalPlannerParams,
    GlobalPlannerROS,
    NavfnParams,
    NavfnROS,
    WaveCosts,
    global_planner_costs,
    navfn_costs,
)
from navstack.plugins import Plan

RESOLUTION = 0.05
KINDS = ["any", "sparse", "walls", "free", "lethal", "unknown"]


def grid(ny: int, nx: int, kind: str, seed: int) -> NDArray[np.uint8]:
    rng = np.random.default_rng(seed)
    if kind == "any":
        return rng.integers(0, 256, (ny, nx), dtype=np.uint8)
    if kind == "sparse":
        return np.where(rng.random((ny, nx)) < 0.25, 254, rng.choice([0, 0, 0, 40, 128, 252, 255], (ny, nx))).astype(
            np.uint8
        )
    if kind == "walls":
        out = np.zeros((ny, nx), np.uint8)
        out[:: max(2, ny // 4)] = 254
        out[rng.integers(0, ny, 4 * ny), rng.integers(0, nx, 4 * ny)] = 0
        return out
    return np.full((ny, nx), {"free": 0, "lethal": 254, "unknown": 255}[kind], np.uint8)


@st.composite
def problems(draw: st.DrawFn, most: int = 32) -> tuple[Costmap, Pose2D, Pose2D]:
    ny, nx = draw(st.integers(1, most)), draw(st.integers(1, most))
    data = grid(ny, nx, draw(st.sampled_from(KINDS)), draw(st.integers(0, 2**32 - 1)))
    g = GridGeometry(nx, ny, RESOLUTION, -0.3, 0.7)

    def pose() -> Pose2D:
        x, y = draw(st.floats(0.0, 0.999)), draw(st.floats(0.0, 0.999))
        return Pose2D(g.origin_x + x * g.width_m, g.origin_y + y * g.height_m, draw(st.floats(-3.1, 3.1)))

    return Costmap(g, data), pose(), pose()


def free_cells(costmap: Costmap, costs: WaveCosts, start: tuple[int, int]) -> NDArray[np.bool_]:
    """Cells a path may enter: not blocked and not on the border, except for the start cell."""
    free = ~costs.blocked[costmap.data]
    free[[0, -1], :] = False
    free[:, [0, -1]] = False
    free[start[1], start[0]] = True
    return free


def check(planner: Any, costs: WaveCosts, problem: tuple[Costmap, Pose2D, Pose2D], *, corners: bool) -> Plan | None:
    """Check that the plan is legal if the connected components allow one, and else that the exception is correct."""
    costmap, start, goal = problem
    before = costmap.data.copy()
    s, t = costmap.geometry.world_to_cell(start.x, start.y), costmap.geometry.world_to_cell(goal.x, goal.y)
    assert s is not None
    assert t is not None
    free = free_cells(costmap, costs, s)
    regions, _ = label(free)
    try:
        plan: Plan = planner.make_plan(costmap, start, goal, keep_potential=True)
    except GoalOccupiedError:
        assert not free[t[1], t[0]]
        return None
    except StartOccupiedError:
        assert (
            costs.blocked[costmap.data[s[1], s[0]]]
            or s[0] in (0, costmap.geometry.nx - 1)
            or s[1] in (0, costmap.geometry.ny - 1)
        )
        assert (regions == regions[s[1], s[0]]).sum() == 1
        return None
    except NoValidPathError:
        assert free[t[1], t[0]]
        assert regions[t[1], t[0]] != regions[s[1], s[0]]
        return None
    finally:
        assert (costmap.data == before).all()
    assert regions[t[1], t[0]] == regions[s[1], s[0]] > 0
    g = costmap.geometry
    cells = (plan.path.poses[:, :2] - (g.origin_x, g.origin_y)) / RESOLUTION - (0.0 if corners else 0.5)
    points = np.rint(cells[:-1]).astype(int)
    for ix, iy in points:
        assert free[iy, ix]
    assert (np.hypot(*np.diff(cells, axis=0).T) <= 2.0).all()
    assert plan.potential is not None
    reached = np.isfinite(plan.potential)
    assert (regions[reached] == regions[s[1], s[0]]).all()
    assert (plan.potential[reached] >= 0.0).all()
    assert plan.cost == float(plan.potential[t[1], t[0]])
    return plan


@settings(deadline=None, max_examples=60)
@given(problem=problems(), unknown=st.booleans())
def test_navfn(problem: tuple[Costmap, Pose2D, Pose2D], unknown: bool) -> None:
    costs = navfn_costs(unknown)
    dijkstra = check(NavfnROS(NavfnParams(allow_unknown=unknown)), costs, problem, corners=True)
    astar = check(NavfnROS(NavfnParams(allow_unknown=unknown, use_astar=True)), costs, problem, corners=True)
    assert (dijkstra is None) == (astar is None)
    if dijkstra is not None and astar is not None:
        # 1 %, plus a third of a step, the largest effect of the order of arrival on a short path
        assert astar.cost <= dijkstra.cost * 1.01 + 0.3 * 253.0


@settings(deadline=None, max_examples=60)
@given(
    problem=problems(),
    dijkstra=st.booleans(),
    quadratic=st.booleans(),
    grid_path=st.booleans(),
    old=st.booleans(),
    unknown=st.booleans(),
    lethal=st.integers(1, 255),
    neutral=st.integers(1, 255),
    factor=st.floats(0.01, 5.0),
)
def test_global_planner(
    problem: tuple[Costmap, Pose2D, Pose2D],
    dijkstra: bool,
    quadratic: bool,
    grid_path: bool,
    old: bool,
    unknown: bool,
    lethal: int,
    neutral: int,
    factor: float,
) -> None:
    params = GlobalPlannerParams(
        use_dijkstra=dijkstra,
        use_quadratic=quadratic,
        use_grid_path=grid_path,
        old_navfn_behavior=old,
        allow_unknown=unknown,
        lethal_cost=lethal,
        neutral_cost=neutral,
        cost_factor=factor,
    )
    costs = global_planner_costs(lethal, neutral, factor, unknown, quadratic)
    check(GlobalPlannerROS(params), costs, problem, corners=old)


@settings(deadline=None, max_examples=40)
@given(problem=problems(24))
def test_the_cost_is_that_of_a_reference_dijkstra(problem: tuple[Costmap, Pose2D, Pose2D]) -> None:
    """The linear potential is the cost of the cheapest 4-connected path, computed here by a reference Dijkstra."""
    costmap, start, goal = problem
    params = GlobalPlannerParams(use_quadratic=False, old_navfn_behavior=True, use_dijkstra=True)
    costs = global_planner_costs(253, 50, 3.0, True, False)
    plan = check(GlobalPlannerROS(params), costs, problem, corners=True)
    if plan is None:
        return
    s, t = costmap.geometry.world_to_cell(start.x, start.y), costmap.geometry.world_to_cell(goal.x, goal.y)
    assert s is not None
    assert t is not None
    best = reference_dijkstra(free_cells(costmap, costs, s), costs.steps[costmap.data], s, t)
    # navfn queues a neighbor only for a gain of 0.7 of its cost, so up to a third of a step may be missing
    assert best * (1.0 - 1e-5) <= plan.cost <= best + 0.3 * 252.0 * math.ceil(best / 2000.0 + 1.0)


def reference_dijkstra(
    free: NDArray[np.bool_], steps: NDArray[np.float32], s: tuple[int, int], t: tuple[int, int]
) -> float:
    from heapq import heappop, heappush

    best = {s: 0.0}
    heap = [(0.0, s)]
    while heap:
        cost, (x, y) = heappop(heap)
        if (x, y) == t:
            return cost
        if cost > best[x, y]:
            continue
        for n in ((x + 1, y), (x - 1, y), (x, y + 1), (x, y - 1)):
            if 0 <= n[0] < free.shape[1] and 0 <= n[1] < free.shape[0] and free[n[1], n[0]]:
                c = cost + float(steps[n[1], n[0]])
                if c < best.get(n, math.inf):
                    best[n] = c
                    heappush(heap, (c, n))
    return math.inf
