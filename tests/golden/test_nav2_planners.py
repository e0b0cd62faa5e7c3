"""NavfnPlanner and ThetaStarPlanner compared with Nav2's, query by query.

Two builds of Nav2 differ by 5e-4 in potentials and 4e-4 m in paths of NavFn; 3 of 486 paths have another number of poses near the
end. Theta*'s paths differ where costs tie, by at most 2 % in length.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from navstack.core import (
    Costmap,
    GoalOccupiedError,
    GoalOutsideMapError,
    GridGeometry,
    NoValidPathError,
    PlanningError,
    Pose2D,
    StartOccupiedError,
    StartOutsideMapError,
)
from navstack.global_planner.navfn import Nav2NavfnParams, Nav2NavfnPlanner
from navstack.global_planner.theta_star import Nav2ThetaStarParams, Nav2ThetaStarPlanner, sight_cost, traversal_values
from navstack.plugins import GLOBAL_PLANNERS, Plan
from tests.conftest import golden_nav2_files
from tests.golden.nav2_w3 import arrays, jobs, needs_data, split, values_of

MAPS = golden_nav2_files("smac_maps.npz")
pytestmark = [
    needs_data,
    pytest.mark.skipif(not MAPS, reason="the golden data of Nav2 are absent (NAVSTACK_GOLDEN_NAV2)"),
]
JOBS = jobs("planners")


def of_plugin(plugin: str) -> list[Any]:
    """Names of jobs; those of the smallest map are quick."""
    names = sorted(name for name, job in JOBS.items() if plugin in job["plugin"])
    quick = [name for name in names if JOBS[name]["map"] == "office"] or names[:1]
    return [name if name in quick else pytest.param(name, marks=pytest.mark.slow) for name in names]


NAVFN, THETA = of_plugin("Navfn"), of_plugin("ThetaStar")
POTENTIAL = 6e-4
"""Difference of two builds (5e-4), with its last digit."""
PATH_M = 4e-4
LENGTH = 0.02
"""Relative difference of the lengths of two builds of Theta*, where costs tie."""
STATUS: dict[type[PlanningError], int] = {
    NoValidPathError: -1,
    StartOccupiedError: -2,
    GoalOccupiedError: -3,
    StartOutsideMapError: -4,
    GoalOutsideMapError: -5,
}


def costmap_of(job: dict[str, Any]) -> Costmap:
    maps = np.load(MAPS[0])
    data, info = maps[f"{job['map']}/{job['costmap_name']}"], maps[f"{job['map']}/info"]
    ny, nx = data.shape
    return Costmap(
        GridGeometry(nx, ny, float(info[2]), float(info[0]), float(info[1])), np.ascontiguousarray(data), "map"
    )


def plan(job: dict[str, Any], costmap: Costmap, query: np.ndarray, *, keep: bool = False) -> tuple[int, Plan | None]:
    """Status as in the golden data, and the plan of a new planner."""
    cls = GLOBAL_PLANNERS.get(job["plugin"]).cls
    start, goal = Pose2D(*query[:3].tolist()), Pose2D(*query[3:].tolist())
    try:
        return 1, cls(cls.Params(**values_of(job))).make_plan(costmap, start, goal, keep_potential=keep)
    except PlanningError as error:
        if isinstance(error, GoalOccupiedError) and error.data["cost"] != 254:
            return -2, None  # Nav2 differs: only a lethal goal is occupied
        return STATUS[type(error)], None


@pytest.mark.sampled
@pytest.mark.parametrize("name", NAVFN)
def test_navfn(name: str) -> None:
    """Status, potential and path; 3 of 486 paths of two builds have another number of poses, so one per job may."""
    job, data = JOBS[name], arrays("planners")
    costmap = costmap_of(job)
    paths = split(data[f"{name}/path"], data[f"{name}/path_counts"])
    kept = data.get(f"{name}/potential_query", np.empty(0)).tolist()
    others = 0
    for i, query in enumerate(data[f"queries/{job['map']}_{job['q']}"]):
        status, found = plan(job, costmap, query, keep=i in kept)
        assert status == data[f"{name}/status"][i], f"query {i}"
        if found is None:
            continue
        if i in kept:
            assert found.potential is not None
            ours, theirs = found.potential, data[f"{name}/potential"][kept.index(i)]
            np.testing.assert_array_equal(np.isinf(ours), theirs > 1e9)
            np.testing.assert_allclose(ours[np.isfinite(ours)], theirs[theirs < 1e9], rtol=0.0, atol=POTENTIAL)
        poses = found.path.poses
        if len(poses) == len(paths[i]):
            np.testing.assert_allclose(poses[:, :2], paths[i][:, :2], rtol=0.0, atol=PATH_M, err_msg=f"query {i}")
            # the heading of a last step of half a cell, and of steps that are shorter
            np.testing.assert_allclose(poses[:, 2], paths[i][:, 2], rtol=0.0, atol=0.02, err_msg=f"query {i}")
        else:
            others += 1
            assert abs(len(poses) - len(paths[i])) <= 2
            assert found.path.length == pytest.approx(data[f"{name}/length"][i], abs=0.1)
    assert others <= 1


def cost_of(corners: np.ndarray, costmap: Costmap, params: Nav2ThetaStarParams) -> float:
    """The cost of straight lines between the centers of cells as Theta* adds it up, without that of the start."""
    g = costmap.geometry
    cells = np.floor((corners - (g.origin_x, g.origin_y)) / g.resolution).astype(int)
    cells = cells[np.append(True, np.abs(np.diff(cells, axis=0)).sum(axis=1) > 0)]
    blocked = np.zeros(256, np.bool_)
    blocked[253:] = True, True, not params.allow_unknown
    flat, values, total = costmap.data.reshape(-1), traversal_values(), 0.0
    for (x0, y0), (x1, y1) in zip(cells[:-1].tolist(), cells[1:].tolist(), strict=True):
        total += params.w_euc_cost * np.hypot(x1 - x0, y1 - y0)
        if max(abs(x1 - x0), abs(y1 - y0)) == 1:
            total += params.w_traversal_cost * (values[flat[y1 * g.nx + x1]] / 252.0) ** 2
        else:
            line = sight_cost(flat, blocked, values, params.w_traversal_cost, g.nx, x1, y1, x0, y0)
            assert line >= 0.0
            total += line
    return float(total)


@pytest.mark.sampled
@pytest.mark.parametrize("name", THETA)
def test_theta_star(name: str) -> None:
    """Status, ends and headings; length and cost within the difference of two builds."""
    job, data = JOBS[name], arrays("planners")
    costmap, params = costmap_of(job), Nav2ThetaStarParams(**values_of(job))
    paths = split(data[f"{name}/path"], data[f"{name}/path_counts"])
    corners = data.get(f"{name}/corners", np.empty((0, 3)))
    same = total = 0
    for i, query in enumerate(data[f"queries/{job['map']}_{job['q']}"]):
        status, found = plan(job, costmap, query)
        assert status == data[f"{name}/status"][i], f"query {i}"
        if found is None:
            continue
        poses, theirs = found.path.poses, paths[i]
        for k in (0, -1):
            np.testing.assert_allclose(poses[k, :2], theirs[k, :2], rtol=0.0, atol=1e-9)
        if not params.use_final_approach_orientation:
            assert poses[-1, 2] == pytest.approx(theirs[-1, 2])
        assert found.path.length == pytest.approx(data[f"{name}/length"][i], rel=LENGTH)
        own = corners[corners[:, 0] == i, 1:]
        if len(own) > 1:
            start = np.array(query[:2])
            ix, iy = np.floor(
                (start - (costmap.geometry.origin_x, costmap.geometry.origin_y)) / costmap.geometry.resolution
            )
            first = params.w_traversal_cost * (traversal_values()[costmap.data[int(iy), int(ix)]] / 252.0) ** 2
            assert found.cost == pytest.approx(first + cost_of(own, costmap, params), rel=LENGTH), f"query {i}"
        total += 1
        same += len(poses) == len(theirs) and bool(np.abs(poses[:, :2] - theirs[:, :2]).max() < 1e-9)
    assert same >= 0.4 * total, "the corners of most paths are the same: 75 of 390 differ between two builds"


def test_a_start_on_an_obstacle_can_be_refused_as_in_nav2() -> None:
    costmap = Costmap(GridGeometry(20, 20, 0.1), np.zeros((20, 20), np.uint8), "map")
    costmap.data[5, 5] = 254
    start, goal = Pose2D(0.55, 0.55), Pose2D(1.5, 1.5)
    assert Nav2ThetaStarPlanner().make_plan(costmap, start, goal).notes
    with pytest.raises(StartOccupiedError):
        Nav2ThetaStarPlanner(Nav2ThetaStarParams(start_policy="refuse")).make_plan(costmap, start, goal)


def test_navfn_limits_the_points_of_a_path() -> None:
    """A serpentine: 4 points per cell of the longer side are not enough."""
    data = np.zeros((41, 41), np.uint8)
    for row in range(4, 40, 4):
        data[row, :] = 254
        data[row, 1 if row % 8 else -2] = 0
    costmap = Costmap(GridGeometry(41, 41, 0.1), data, "map")
    start, goal = Pose2D(0.2, 0.2), Pose2D(3.8, 3.8)
    with pytest.raises(NoValidPathError, match="max_cycles_factor"):
        Nav2NavfnPlanner().make_plan(costmap, start, goal)
    found = Nav2NavfnPlanner(Nav2NavfnParams(max_cycles_factor=40)).make_plan(costmap, start, goal)
    assert len(found.path) > 4 * 41
