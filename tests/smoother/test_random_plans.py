"""Smoothed plans on random maps: free where the plan was, with its ends, cusps and turning radius; by shapely, not by kernels."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

from navstack.core import Footprint, Path, Pose2D
from navstack.core.errors import PlanningError
from navstack.plugins import GLOBAL_PLANNERS, SMOOTHERS
from navstack.smoother import ConstrainedSmoother, ConstrainedSmootherParams, SimpleSmoother, SmoothedPlanner
from tests.global_planner.pose_referee import inflated
from tests.smoother.test_smoothers import empty

RADIUS = 0.5
"""Turning radius (m)."""
CELL = 0.05
BOX = Footprint(np.array([[0.35, 0.2], [-0.25, 0.2], [-0.25, -0.2], [0.35, -0.2]]))


def between(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Poses an eighth of a cell apart; between two given ones on a line, on which the heading turns evenly."""
    steps = np.diff(poses, axis=0)
    steps[:, 2] = np.remainder(steps[:, 2] + np.pi, 2.0 * np.pi) - np.pi
    counts = np.ceil((np.hypot(steps[:, 0], steps[:, 1]) + 0.4 * np.abs(steps[:, 2])) / (CELL / 8.0)).astype(int) + 1
    return np.concatenate(
        [a + np.linspace(0.0, 1.0, n)[:, None] * d for a, d, n in zip(poses, steps, counts, strict=False)]
    )


def overlap_m2(poses: NDArray[np.float64], lethal: NDArray[Any]) -> float:
    """Largest area of a lethal cell under the footprint on the way."""
    p = between(poses)
    c, s = np.cos(p[:, 2, None]), np.sin(p[:, 2, None])
    x, y = BOX.vertices.T
    polygons: NDArray[Any] = np.asarray(
        shapely.polygons(np.stack((p[:, :1] + c * x - s * y, p[:, 1:2] + s * x + c * y), -1))
    )
    i, j = shapely.STRtree(lethal).query(polygons, predicate="intersects")
    return float(shapely.area(shapely.intersection(polygons[i], lethal[j])).max(initial=0.0))


def bend(poses: NDArray[np.float64]) -> float:
    """Largest turn between two headings (1/m), over the longer of the step and the mean of the step and the next one."""
    length = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    length = np.maximum(length, 0.5 * (length + np.append(length[1:], 0.0)))
    turn = np.abs(np.remainder(np.diff(poses[:, 2]) + np.pi, 2.0 * np.pi) - np.pi)
    return float((2.0 * np.sin(0.5 * turn) / np.maximum(length, 1e-9))[length > 1e-4].max())


@pytest.mark.parametrize("name", ["astar", "smac_hybrid"])
def test_smoothed_plans(name: str) -> None:
    rng = np.random.default_rng(11)
    moved: dict[str, int] = {}
    for _ in range(12):
        grid = np.zeros((70, 90), bool)
        for y, x, h, w in zip(*rng.integers([[5], [5], [1], [1]], [[65], [85], [8], [8]], (4, 5)), strict=True):
            grid[y : y + h, x : x + w] = True
        costmap = inflated(grid, CELL, BOX.inscribed_radius)
        iy, ix = np.nonzero(grid)
        lethal = np.asarray(shapely.box(ix * CELL, iy * CELL, (ix + 1) * CELL, (iy + 1) * CELL))
        values: dict[str, Any] = {}
        if name == "smac_hybrid":
            values = {"minimum_turning_radius": RADIUS, "motion_model_for_search": "REEDS_SHEPP", "smooth_path": False}
        planner = GLOBAL_PLANNERS.get(name)
        ends = [Pose2D(*rng.uniform([0.6, 0.6, -3.0], [3.9, 2.9, 3.0])) for _ in range(2)]
        try:
            plan = planner.cls(planner.cls.Params(**values)).make_plan(costmap, *ends, footprint=BOX)
        except PlanningError:
            continue
        before = plan.path.poses
        for entry in SMOOTHERS:
            values = {"minimum_turning_radius": RADIUS}
            smoother = entry.cls(entry.cls.Params(**values))
            after = smoother.smooth(plan.path, costmap, footprint=BOX).poses
            assert after.tobytes() == smoother.smooth(Path(before.copy()), costmap, footprint=BOX).poses.tobytes()
            if len(after) == len(before) and np.array_equal(after, before):
                continue
            moved[entry.name] = moved.get(entry.name, 0) + 1
            assert after[[0, -1]] == pytest.approx(before[[0, -1]], abs=1e-9), entry.name
            if overlap_m2(before, lethal) == 0.0:
                assert overlap_m2(after, lethal) < 1e-9, entry.name
            if name == "smac_hybrid":
                assert Path(after).cusps == Path(before).cusps, entry.name
            assert bend(after) < 1.05 * max(1.0 / RADIUS, bend(before)), entry.name
    assert len(moved) == 3 and min(moved.values()) >= 2


def test_a_corner_is_not_cut_between_poses() -> None:
    """The poses of the smoothed path are free, but the steps between them are not; the ways to the corner become smooth."""
    costmap = empty()
    costmap.data[:100, :100] = 254
    noise = 0.03 * (-1.0) ** np.arange(20)
    x = np.concatenate((np.arange(1.0, 5.0, 0.2), [5.05], 5.05 + noise[:19]))
    y = np.concatenate((5.05 + noise, [5.05], np.arange(4.8, 1.0, -0.2)))
    yaw = np.append(np.arctan2(np.diff(y), np.diff(x)), -1.57)
    poses = np.column_stack((x, y, yaw))
    out = SimpleSmoother().smooth(Path(poses), costmap).poses
    fine = between(out)
    assert max(costmap.cost_at(float(a), float(b)) or 0 for a, b in fine[:, :2]) == 0
    assert np.ptp(out[3:10, 1]) < 0.02 and np.ptp(out[30:37, 0]) < 0.02


def test_a_plan_of_navfn_to_the_west_is_driven_forward() -> None:
    """Its headings are 0, as in ROS: to a smoother, such a path is driven backward."""
    navfn = GLOBAL_PLANNERS.get("navfn")
    plan = SmoothedPlanner(navfn.cls(navfn.cls.Params()), SimpleSmoother()).make_plan(
        empty(), Pose2D(8.0, 2.0), Pose2D(2.0, 3.0, 3.0)
    )
    signs = plan.path.directions
    assert (signs >= 0).all() and (signs > 0).mean() > 0.95


def test_free_headings_at_the_ends() -> None:
    x = np.linspace(2.0, 4.0, 21)
    poses = np.column_stack((x, np.full(21, 5.0), np.zeros(21)))
    poses[[0, -1], 2] = 0.5
    free = ConstrainedSmootherParams(keep_start_orientation=False, keep_goal_orientation=False)
    kept = ConstrainedSmoother().smooth(Path(poses), empty()).poses
    assert kept[[0, -1], 2].tolist() == [0.5, 0.5]
    out = ConstrainedSmoother(free).smooth(Path(poses), empty()).poses
    assert np.abs(out[[0, -1], 2]).max() < 1e-9
