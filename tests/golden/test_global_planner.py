"""global_planner compared with the results of C++: potentials, all eight combinations, plans in the world.

Tolerances: potentials 1e-6 relative (required: 1e-4). The cost of a path is the integral of the cells' costs along it, in
cells, with ten samples per cell. It may exceed that of C++ by at most 0.5 %; the sampling has an error of a tenth of a cell
at either end.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from navstack.core import Costmap, GridGeometry, NoValidPathError, Pose2D
from navstack.global_planner import GlobalPlannerParams, GlobalPlannerROS, global_planner_costs
from tests.conftest import golden_files
from tests.golden.plan_cases import Case, cases

POTENTIAL_TOLERANCE = 1e-6
COST_TOLERANCE = 0.005
CPP_UNREACHED = 1e10
COMBINATIONS = [
    (expander, calculator, traceback)
    for expander in ("dijkstra", "astar")
    for calculator in ("lin", "quad")
    for traceback in ("gradient", "grid")
]


def costmap_of(data: dict[str, NDArray[Any]], golden_dir: Path) -> Costmap:
    costs = data.get("costs")
    if costs is None:
        with np.load(golden_dir / "costmap_static_willow010_r020_csf5.npz") as z:
            costs = z["master"]
    return Costmap(GridGeometry(costs.shape[1], costs.shape[0], 0.1), costs)


def params_of(query: NDArray[np.float64], expander: str, calculator: str, traceback: str) -> GlobalPlannerParams:
    old, unknown, factor, neutral, lethal = query[8:13]
    return GlobalPlannerParams(
        use_dijkstra=expander == "dijkstra",
        use_quadratic=calculator == "quad",
        use_grid_path=traceback == "grid",
        old_navfn_behavior=bool(old),
        allow_unknown=bool(unknown),
        cost_factor=float(factor),
        neutral_cost=int(neutral),
        lethal_cost=int(lethal),
    )


def ends(query: NDArray[np.float64]) -> tuple[Pose2D, Pose2D]:
    """Start and goal in the world. With old_navfn_behavior C++ uses their cells only: here the centers of these cells."""
    cells = query[4:8] if query[8] else query[0:4]
    sx, sy, gx, gy = ((cells + 0.5) * 0.1).tolist()
    return Pose2D(sx, sy), Pose2D(gx, gy)


def to_cells(points: NDArray[np.float64], old_navfn_behavior: bool) -> NDArray[np.float64]:
    """Points (n, 2) of a plan in the cells of C++'s paths: with old_navfn_behavior a cell's corner has whole numbers."""
    return points / 0.1 - (0.0 if old_navfn_behavior else 0.5)


def path_cost(cells: NDArray[Any], steps: NDArray[np.float32], costs: NDArray[np.uint8]) -> float:
    """Integral of the cells' costs along a path (n, 2) in cells, with centers at whole numbers."""
    total = 0.0
    for a, b in zip(cells[:-1].astype(float), cells[1:].astype(float), strict=True):
        length = float(np.hypot(*(b - a)))
        n = max(1, int(np.ceil(length * 10)))
        at = a + (np.arange(n) + 0.5)[:, None] / n * (b - a)
        ij = np.rint(at).astype(int)
        total += steps[costs[ij[:, 1], ij[:, 0]]].sum() * length / n
    return total


@pytest.mark.parametrize("combination", COMBINATIONS, ids="-".join)
@pytest.mark.parametrize("case", list(cases("gp_*.npz")), ids=str)
def test_every_combination(case: Case, combination: tuple[str, str, str], golden_dir: Path) -> None:
    expander, calculator, traceback = combination
    data = case.load()
    query = data["query"]
    costmap = costmap_of(data, golden_dir)
    params = params_of(query, *combination)
    planner = GlobalPlannerROS(params)
    reachable = np.asarray(data["summary"])[..., 0].any()
    start, goal = ends(query)
    if not reachable:
        with pytest.raises(NoValidPathError):
            planner.make_plan(costmap, start, goal)
        return
    plan = planner.make_plan(costmap, start, goal, keep_potential=True)
    assert plan.potential is not None
    key = f"dijkstra_{calculator}_pot_raw"
    if expander == "dijkstra" and key in data:
        expected = data[key]
        both = np.isfinite(plan.potential) & (expected < CPP_UNREACHED)
        assert both.sum() > 0.95 * (expected < CPP_UNREACHED).sum()
        np.testing.assert_allclose(plan.potential[both], expected[both], rtol=POTENTIAL_TOLERANCE)
    rule = global_planner_costs(
        params.lethal_cost, params.neutral_cost, params.cost_factor, params.allow_unknown, params.use_quadratic
    )
    cells = to_cells(plan.path.poses[:, :2], params.old_navfn_behavior)
    assert np.hypot(*np.diff(cells, axis=0).T).max() < 2.0
    expected_path = data[f"{expander}_{calculator}_{traceback}_path"]
    if len(expected_path):
        ours = path_cost(cells, rule.steps, costmap.data)
        # C++ paths run from goal to start; both ends are connected to the same two points
        first, last = (to_cells(np.array([end[:2]]), params.old_navfn_behavior) for end in (start, goal))
        if params.old_navfn_behavior:
            first = expected_path[-1:]  # the start itself is not a point of the plan
        theirs = np.vstack([first, expected_path[::-1], last])
        assert ours <= path_cost(theirs, rule.steps, costmap.data) * (1.0 + COST_TOLERANCE)


def hausdorff(a: NDArray[Any], b: NDArray[Any]) -> float:
    return max(cKDTree(a).query(b)[0].max(), cKDTree(b).query(a)[0].max())


def worlds() -> Iterator[tuple[Path, str]]:
    for file in golden_files("plans_world*.npz"):
        with np.load(file) as z:
            for key in z.files:
                if key.startswith(("gp_dijkstra", "gp_oldnavfn")) and len(z[key]):
                    yield file, key


@pytest.mark.parametrize(("file", "key"), list(worlds()), ids=lambda v: v if isinstance(v, str) else v.stem)
def test_plans_in_the_world(file: Path, key: str, golden_dir: Path) -> None:
    costmap = costmap_of({}, golden_dir)
    with np.load(file) as z:
        expected = z[key]
        sx, sy, gx, gy = z["queries_world"][int(key.rpartition("q")[2])]
    params = GlobalPlannerParams(
        use_quadratic="_lin_" not in key, use_grid_path="_grid_" in key, old_navfn_behavior="oldnavfn" in key
    )
    plan = GlobalPlannerROS(params).make_plan(costmap, Pose2D(sx, sy, 0.5), Pose2D(gx, gy, 1.0))
    poses = plan.path.poses
    # one and a half cells: a grid path of C++ begins and ends in a neighbor of the first and last cell here (parity 12)
    assert hausdorff(poses[:, :2], expected[:, :2]) < 0.15
    assert poses[-1] == pytest.approx(expected[-1])
    assert poses[0, :2] == pytest.approx(expected[0, :2], abs=0.15)
    # headings: at the points that both have
    near = cKDTree(poses[:, :2]).query(expected[:, :2])
    if params.old_navfn_behavior:
        # both count from cells' corners: the same points, up to the float32 of C++
        assert near[0].max() < 1e-5
    same = near[0] < 1e-3
    turned = np.abs((poses[near[1][same], 2] - expected[same, 2] + np.pi) % (2.0 * np.pi) - np.pi)
    if same.sum() > 10:
        assert np.quantile(turned, 0.9) < 1e-2
