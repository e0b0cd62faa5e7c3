"""smac_2d compared with Nav2's SmacPlanner2D: the same reachability, at a cost that is not higher.

Cost of a path: integral of 1 + cost_travel_multiplier c / 252 (squared where that is set) over its length, the same for both. C++
passes between two blocked cells at corners and enters inscribed cells there, which our planner does not.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from navstack.core import Costmap, Footprint, GridGeometry, Pose2D
from navstack.global_planner import Smac2DParams, Smac2DPlanner
from tests.golden.test_smac import FILES, JOBS, archive

GRIDS = [n for n, job in JOBS.items() if job["plugin"].endswith("SmacPlanner2D")]
pytestmark = pytest.mark.skipif(not FILES, reason="the golden data of Nav2 are absent (NAVSTACK_GOLDEN_NAV2)")


def cost_of(poses: NDArray[np.float64], costmap: Costmap, params: Smac2DParams) -> float:
    g = costmap.geometry
    total = 0.0
    for a, b in zip(poses[:-1, :2], poses[1:, :2], strict=True):
        n = max(1, int(np.hypot(*(b - a)) / (0.1 * g.resolution)))
        at = a + (b - a) * ((np.arange(n) + 0.5) / n)[:, None]
        ix = np.clip(((at[:, 0] - g.origin_x) / g.resolution).astype(int), 0, g.nx - 1)
        iy = np.clip(((at[:, 1] - g.origin_y) / g.resolution).astype(int), 0, g.ny - 1)
        share = np.minimum(costmap.data[iy, ix], 252) / 252.0
        weight = 1.0 + params.cost_travel_multiplier * (share**2 if params.use_quadratic_cost_penalty else share)
        total += float(np.hypot(*(b - a)) * weight.mean())
    return total


@pytest.mark.slow
@pytest.mark.parametrize("name", GRIDS)
def test_found_wherever_cpp_finds_and_not_costlier(name: str) -> None:
    job, maps, paths = JOBS[name], archive("smac_maps.npz"), archive("smac_paths.npz")
    x, y, resolution = (float(v) for v in maps[f"{job['map']}/info"])
    data = maps[f"{job['map']}/costmap_{job['footprint']}"]
    costmap = Costmap(GridGeometry(data.shape[1], data.shape[0], resolution, x, y), data)
    footprint = None if job["use_radius"] else Footprint(maps[f"footprint/{job['footprint']}"])
    given = {k: v for k, v in job["params"].items() if k not in Smac2DParams.NO_EFFECT}
    params = Smac2DParams(**given)
    planner = Smac2DPlanner(params)
    raws = np.split(paths[f"{name}/raw"], np.cumsum(paths[f"{name}/raw_counts"])[:-1])
    for k, query in enumerate(paths[f"{name}/queries"]):
        if paths[f"{name}/status"][k] != 1:
            continue
        start, goal = Pose2D(*(float(v) for v in query[:3])), Pose2D(*(float(v) for v in query[3:]))
        plan = planner.make_plan(costmap, start, goal, footprint=footprint)
        assert plan.goal_moved_m <= params.tolerance * np.sqrt(2.0) + resolution
        # C++'s points are the corners of the cells: half a cell is added; ends differ by up to a cell
        theirs = cost_of(raws[k].astype(np.float64) + [0.5 * resolution, 0.5 * resolution, 0.0], costmap, params)
        assert cost_of(plan.path.poses, costmap, params) <= 1.02 * theirs + 3.0 * resolution, k
