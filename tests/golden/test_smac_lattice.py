"""smac_lattice compared with Nav2's SmacPlannerLattice: found wherever C++ finds, at a cost that is not higher.

Primitives: those of Nav2's sample files, generated here (tests/lattice compares the sets). Cost of a path: that of
`test_smac.py`, plus rotation_penalty for turns in place by the angle between two headings, for both alike; an omnidirectional
robot has no backward. `tools/bench/smac_lattice.py` plans all queries.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from navstack.core import Costmap, Footprint, GridGeometry, PlanningError, Pose2D
from navstack.global_planner import SmacHybridParams, SmacLatticeParams, SmacLatticePlanner
from tests.golden.test_smac import FILES, JOBS, MOST, WORST, archive, cost_of

LATTICE = [n for n, job in JOBS.items() if job["plugin"].endswith("SmacPlannerLattice")]
MAX_ITERATIONS = 10_000
"""Queries that took C++ more iterations are left to the benchmark."""
HEADING_STEP = 0.4636
pytestmark = pytest.mark.skipif(not FILES, reason="the golden data of Nav2 are absent (NAVSTACK_GOLDEN_NAV2)")


def cost_with_turns(poses: NDArray[np.float64], costmap: Costmap, params: SmacLatticeParams, omni: bool) -> float:
    still = np.hypot(*np.diff(poses[:, :2], axis=0).T) < 1e-3
    turn = np.abs(np.remainder(np.diff(poses[:, 2]) + np.pi, 2.0 * np.pi) - np.pi)[still].sum()
    values = SmacHybridParams(cost_penalty=params.cost_penalty, reverse_penalty=1.0 if omni else params.reverse_penalty)
    rotation = params.rotation_penalty * costmap.geometry.resolution / HEADING_STEP
    return cost_of(poses, costmap, values) + rotation * float(turn)


def ratios(name: str, job: dict[str, Any]) -> list[float]:
    """Our cost over C++'s for the queries that C++ solved: all of them must be found."""
    maps, paths = archive("smac_maps.npz"), archive("smac_paths.npz")
    x, y, resolution = (float(v) for v in maps[f"{job['map']}/info"])
    data = maps[f"{job['map']}/costmap_{job['footprint']}"]
    costmap = Costmap(GridGeometry(data.shape[1], data.shape[0], resolution, x, y), data)
    footprint = None if job["use_radius"] else Footprint(maps[f"footprint/{job['footprint']}"])
    params = SmacLatticeParams(**{k: v for k, v in job["params"].items() if k != "max_planning_time"})
    planner = SmacLatticePlanner(params)
    raws = np.split(paths[f"{name}/raw"], np.cumsum(paths[f"{name}/raw_counts"])[:-1])
    found: list[float] = []
    for k, query in enumerate(paths[f"{name}/queries"]):
        if paths[f"{name}/status"][k] != 1 or paths[f"{name}/iterations"][k] > MAX_ITERATIONS:
            continue
        start, goal = Pose2D(*(float(v) for v in query[:3])), Pose2D(*(float(v) for v in query[3:]))
        try:
            plan = planner.make_plan(costmap, start, goal, footprint=footprint)
        except PlanningError as error:
            pytest.fail(f"{name}, query {k}: {error}")
        assert plan.goal_moved_m == 0.0
        omni = "omni" in params.lattice_filepath
        ours, theirs = (
            cost_with_turns(p, costmap, params, omni) for p in (plan.path.poses, raws[k].astype(np.float64))
        )
        found.append(ours / max(theirs, resolution))
    return found


@pytest.mark.slow
def test_found_wherever_cpp_finds_and_not_costlier() -> None:
    assert LATTICE
    everything = np.array([ratio for name in LATTICE for ratio in ratios(name, JOBS[name])])
    assert float(np.mean(everything <= MOST)) >= 0.95
    assert everything.max() <= WORST
