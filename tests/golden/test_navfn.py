"""navfn compared with the results of C++: potentials, paths, and plans in the world, for every stored query.

Tolerances: potentials 1e-6 relative (float32; required: 1e-4); paths 0.51 cells Hausdorff, because the last steps of C++
differ by half a cell; otherwise the paths are the same (required: one cell).
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from navstack.core import Costmap, GoalOccupiedError, GridGeometry, NoValidPathError, Pose2D
from navstack.global_planner import NavfnParams, NavfnROS, WaveCosts, navfn_costs, wave_costs
from navstack.global_planner._search.propagation import propagate_navfn
from navstack.global_planner._search.traceback import navfn_path
from navstack.global_planner._search.wavefront import Wavefront
from tests.conftest import GOLDEN_PART, golden_files
from tests.golden.plan_cases import Case, cases

POTENTIAL_TOLERANCE = 1e-6
PATH_TOLERANCE_CELLS = 0.51
CPP_UNREACHED = 1e10
ASTAR_TOLERANCE = 0.01


def raw_costs() -> WaveCosts:
    """Mode 0: the bytes are the costs of navfn."""
    steps = np.arange(256, dtype=np.float32)
    return wave_costs(steps, steps >= 254)


def costs_of(case: Case, data: dict[str, NDArray[Any]], golden_dir: Path) -> NDArray[np.uint8]:
    if "costmap" in data:
        return data["costmap"]
    if int(data["query"][2]) == 0:
        from PIL import Image

        with Image.open(GOLDEN_PART / "willow_costmap.png") as image:  # navfn/test/willow_costmap.pgm
            return np.array(image)
    with np.load(golden_dir / "costmap_static_willow010_r020_csf5.npz") as z:
        return z["master"]


def hausdorff(a: NDArray[Any], b: NDArray[Any]) -> float:
    return max(cKDTree(a).query(b)[0].max(), cKDTree(b).query(a)[0].max())


@pytest.mark.parametrize("stop", [False, True], ids=["full", "at_start"])
@pytest.mark.parametrize("case", list(cases("navfn_*.npz")), ids=str)
def test_dijkstra(case: Case, stop: bool, golden_dir: Path) -> None:
    data = case.load()
    nx, ny, mode, sx, sy, gx, gy = (int(v) for v in data["query"])
    costs = costs_of(case, data, golden_dir)
    assert costs.shape == (ny, nx)
    interpreter = raw_costs() if mode == 0 else navfn_costs(mode == 1)
    wave = Wavefront()
    # the potential of NavFn is 0 at its goal and is propagated to its start
    costmap = Costmap(GridGeometry(nx, ny, 0.1), costs)
    propagate_navfn(wave, costmap, interpreter, root=(gx, gy), target=(sx, sy), stop=stop)
    key = "dijkstra_atstart" if stop else "dijkstra"
    potential = wave.full_potential()
    meta = data[f"{key}_meta"]
    # C++ stops after max(nx*ny/20, nx+ny) rounds (parity 4): then it reaches fewer cells and fails where navstack succeeds
    capped = np.isfinite(potential).sum() > meta[3]
    if f"{key}_pot" in data:
        expected = data[f"{key}_pot"]
        both = np.isfinite(potential) & (expected < CPP_UNREACHED)
        assert both.sum() == min(meta[3], np.isfinite(potential).sum())
        np.testing.assert_allclose(potential[both], expected[both], rtol=POTENTIAL_TOLERANCE)
    if not capped:
        assert np.isfinite(potential).sum() == meta[3]
        assert np.isfinite(wave.potential_of(sx, sy)) == bool(meta[0])
    if not np.isfinite(wave.potential_of(sx, sy)):
        assert not meta[0]
        return
    path = navfn_path(wave, (sx, sy), root=(gx, gy))
    assert path[0].tolist() == [sx, sy]
    assert path[-1].tolist() == [gx, gy]
    assert np.hypot(*np.diff(path, axis=0).T).max() < 2.0
    if meta[0]:
        assert float(wave.potential_of(sx, sy)) == pytest.approx(meta[2], rel=POTENTIAL_TOLERANCE)
        assert hausdorff(path, data[f"{key}_path"]) < PATH_TOLERANCE_CELLS


# raw costs (mode 0) are not those of a costmap, for which A* is designed
@pytest.mark.parametrize("case", [c for c in cases("navfn_*.npz") if int(c.load()["query"][2]) != 0], ids=str)
def test_astar_costs_what_dijkstra_does(case: Case, golden_dir: Path) -> None:
    data = case.load()
    nx, ny, mode, sx, sy, gx, gy = (int(v) for v in data["query"])
    assert mode != 0
    costmap = Costmap(GridGeometry(nx, ny, 0.1), costs_of(case, data, golden_dir))
    start, goal = Pose2D(*costmap.geometry.cell_to_world(gx, gy)), Pose2D(*costmap.geometry.cell_to_world(sx, sy))
    plans = []
    for use_astar in (False, True):
        planner = NavfnROS(NavfnParams(allow_unknown=mode == 1, use_astar=use_astar))
        try:
            plans.append(planner.make_plan(costmap, start, goal))
        except NoValidPathError:
            plans.append(None)
    dijkstra, astar = plans
    assert (dijkstra is None) == (astar is None)
    if dijkstra is not None and astar is not None:
        assert astar.cost <= dijkstra.cost * (1.0 + ASTAR_TOLERANCE)
        assert astar.cells_expanded <= dijkstra.cells_expanded


def worlds() -> Iterator[tuple[Path, str]]:
    for file in golden_files("plans_world*.npz"):
        with np.load(file) as z:
            for key in z.files:
                if key.startswith(("navfn_unk_q", "navfn_nounk_q")):
                    yield file, key


@pytest.fixture(scope="module")
def willow(golden_dir: Path) -> Costmap:
    with np.load(golden_dir / "costmap_static_willow010_r020_csf5.npz") as z:
        master = z["master"]
    return Costmap(GridGeometry(master.shape[1], master.shape[0], 0.1), master)


@pytest.mark.parametrize(("file", "key"), list(worlds()), ids=lambda v: v if isinstance(v, str) else v.stem)
def test_plans_in_the_world(file: Path, key: str, willow: Costmap) -> None:
    with np.load(file) as z:
        expected = z[key]
        sx, sy, gx, gy = z["queries_world"][int(key.rpartition("q")[2])]
    planner = NavfnROS(NavfnParams(allow_unknown="nounk" not in key))
    start, goal = Pose2D(sx, sy, 0.5), Pose2D(gx, gy, 1.0)
    if not len(expected):
        with pytest.raises((NoValidPathError, GoalOccupiedError)):
            planner.make_plan(willow, start, goal)
        return
    plan = planner.make_plan(willow, start, goal)
    poses = plan.path.poses
    assert hausdorff(poses[:, :2], expected[:, :2]) < PATH_TOLERANCE_CELLS * willow.geometry.resolution
    assert poses[-1] == pytest.approx(expected[-1])
    assert (poses[:-1, 2] == 0.0).all()
    assert (expected[:-1, 2] == 0.0).all()
    assert poses[0] == pytest.approx(expected[0])


def test_tolerance_around_a_goal_in_an_obstacle(golden_dir: Path, willow: Costmap) -> None:
    with np.load(golden_dir / "plans_world.npz") as z:
        expected = z["navfn_tol05_goal_in_obstacle"]
    start, goal = Pose2D(29.75, 7.95), Pose2D(30.85, 6.65)
    plan = NavfnROS(NavfnParams(default_tolerance=0.5)).make_plan(willow, start, goal)
    assert hausdorff(plan.path.poses[:, :2], expected[:, :2]) < 1e-4
    assert plan.goal_moved_m == pytest.approx(np.hypot(*(expected[-1, :2] - (30.85, 6.65))))
    with pytest.raises(GoalOccupiedError, match=r"lethal \(254\)"):
        NavfnROS().make_plan(willow, start, goal)
