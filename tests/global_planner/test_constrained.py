"""The constrained smoother: Nav2's results, the minimum itself, radius, obstacles, cusps, turns in place."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares

from navstack.core import Costmap, Footprint, GridGeometry, Path, Pose2D, footprint_cost
from navstack.global_planner.smoothers import ConstrainedSmoother, ConstrainedSmootherParams
from navstack.global_planner.smoothers.base import curvatures, cusp_indices
from navstack.global_planner.smoothers.constrained import Problem, Stops, Weights, minimize
from navstack.parameters import load_configuration
from tests.global_planner.test_smoothers import FILES, JOBS, empty, noisy

POINT_M, YAW = 5e-4, 1e-3
"""The iterations end at a relative change of the sum of 1e-7 on both sides: 0.17 mm at most in the half that is here."""


def smoother(**values: Any) -> ConstrainedSmoother:
    return ConstrainedSmoother(ConstrainedSmootherParams(**values))


@pytest.mark.slow
@pytest.mark.skipif(not FILES, reason="the golden data of Nav2 are absent (NAVSTACK_GOLDEN_NAV2)")
def test_equal_to_nav2_and_free() -> None:
    """`unchecked` is Nav2's path; `smooth` is free and keeps the radius where the path did."""
    maps, data = np.load(FILES["smac_maps.npz"]), np.load(FILES["smoothers.npz"])
    jobs = {n: j for n, j in JOBS.items() if "Constrained" in j["plugin"] and data[f"{n}/status_ms"][0] == 1}
    assert jobs
    smoothed = 0
    for name, job in jobs.items():
        x, y, resolution = (float(v) for v in maps[f"{job['map']}/info"])
        costs = maps[f"{job['map']}/costmap_round"]
        costmap = Costmap(GridGeometry(costs.shape[1], costs.shape[0], resolution, x, y), costs)
        made = smoother(**{key.removeprefix("smoother."): value for key, value in job["params"].items()})
        poses = data["in/" + job["input"]].astype(np.float64)
        ours, theirs = made.unchecked(Path(poses), costmap), data[f"{name}/path"]
        assert np.hypot(*(ours - theirs)[:, :2].T).max() < POINT_M, name
        assert np.abs(np.remainder(ours[:, 2] - theirs[:, 2] + np.pi, 2.0 * np.pi) - np.pi).max() < YAW, name
        out = made.smooth(Path(poses), costmap).poses
        blocked = [costmap.cost_at(float(a), float(b)) in (None, 253, 254) for a, b in poses[:, :2]]
        if not any(blocked):
            assert all(costmap.cost_at(float(a), float(b)) not in (None, 253, 254) for a, b in out[:, :2]), name
        if "hybrid" in name:
            sharp = max(2.5, *(curvatures(p).max(initial=0.0) for p in pieces(poses)))
            assert max(curvatures(p).max(initial=0.0) for p in pieces(out)) <= sharp + 1e-5, name
            smoothed += len(out) != len(poses) or bool(np.abs(out - poses).max() > 1e-6)
    assert smoothed >= 0.6 * sum("hybrid" in n for n in jobs)


def pieces(poses: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    bounds = [0, *cusp_indices(poses), len(poses) - 1]
    return [poses[a : b + 1] for a, b in pairwise(bounds)]


def test_the_minimum() -> None:
    """The derivatives are those of the residuals, and scipy's dense solver finds no lower sum."""
    rng = np.random.default_rng(0)
    costmap = Costmap(GridGeometry(50, 40, 0.05), rng.integers(0, 200, (40, 50)).astype(np.uint8))
    n = 14
    points = np.column_stack((np.linspace(0.5, 1.5, n), 1.0 + 0.1 * rng.normal(size=n)))
    ratio = np.full(n, 1.1)
    ratio[5] = -0.9
    free = np.ones(n, np.bool_)
    free[[0, -1]] = False
    weights = Weights(3.0, 0.01, 0.2)
    given = points + 0.01, ratio, np.full(n, 1e-3), np.ones(n)
    problem = Problem.of(costmap, weights, given, free, np.zeros(n, np.bool_), np.zeros((0, 3)))
    j = problem.evaluate(points)[2]
    for k in range(n):
        for axis in (0, 1):
            step = np.zeros((n, 2))
            step[k, axis] = 1e-6
            numeric = (problem.evaluate(points + step)[1] - problem.evaluate(points - step)[1]) / 2e-6
            for p in range(3):
                if 0 <= k - p < n - 2 and free[k]:
                    assert j[k - p, :, p, axis] == pytest.approx(numeric[k - p], abs=1e-5, rel=1e-5)
    found = minimize(problem, points, Stops(200, 1e-15, 1e-12, 1e-12))
    assert found is not None

    def residuals(inner: NDArray[np.float64]) -> NDArray[np.float64]:
        return problem.evaluate(np.concatenate([points[:1], inner.reshape(-1, 2), points[-1:]]))[1].ravel()

    best = least_squares(residuals, points[1:-1].ravel(), method="lm", xtol=1e-12, ftol=1e-12)
    assert problem.evaluate(found)[0] <= best.cost * (1.0 + 1e-4)


def test_the_turning_radius_is_kept() -> None:
    """A path of arcs of 1 m with a kink that its smoothing would sharpen elsewhere."""
    angles = np.linspace(0.0, 1.5 * math.pi, 60)
    circle = Path(np.column_stack((5.0 + np.cos(angles), 5.0 + np.sin(angles), angles + math.pi / 2.0)))
    out = smoother(minimum_turning_radius=1.0).smooth(circle, empty())
    assert curvatures(out.poses).max() <= 1.0 + 1e-3
    wide = smoother(minimum_turning_radius=0.5).smooth(noisy(), empty())
    assert curvatures(wide.poses).max() < curvatures(noisy().poses).max()


def test_cusps_move_with_the_path() -> None:
    forward = [(x, 5.0, 0.0) for x in np.arange(2.0, 4.05, 0.1)]
    back = [(x, 5.0 + 0.2 * (4.0 - x) ** 2, 0.0) for x in np.arange(3.9, 2.0, -0.1)]
    path = Path(np.array(forward + back))
    out = smoother(minimum_turning_radius=0.0).smooth(path, empty())
    assert (out.directions[[1, -2]] == [1, -1]).all()
    assert len(cusp_indices(out.poses)) == 1
    assert (out.poses[[0, -1]] == path.poses[[0, -1]]).all()


def test_turns_in_place_stay() -> None:
    there = [(x, 5.0, 0.0) for x in np.arange(2.0, 4.05, 0.1)]
    turn = [(4.0, 5.0, a) for a in np.linspace(0.2, math.pi / 2.0, 6)]
    on = [(4.0, y, math.pi / 2.0) for y in np.arange(5.1, 7.0, 0.1)]
    path = Path(np.array(there + turn + on))
    out = smoother().smooth(path, empty())
    assert np.isfinite(out.poses).all()
    assert out.poses == pytest.approx(path.poses, abs=1e-6)


def test_costs_under_points_of_the_robot() -> None:
    """An obstacle next to the path: the path moves away from it, further with a point that reaches over to it."""
    costmap = empty()
    iy, ix = np.mgrid[0:200, 0:200]
    costmap.data[:] = np.clip(250.0 - 6.0 * np.hypot(ix - 80.0, iy - 92.0), 0.0, 250.0).astype(np.uint8)
    path = Path(np.column_stack((np.linspace(2.0, 6.0, 61), np.full(61, 5.0), np.zeros(61))))
    values: dict[str, Any] = {"w_smooth": 3000.0, "w_cost": 4.5e-5, "w_curve": 0.5}
    offset = [
        float(np.abs(smoother(**values, **more).unchecked(path, costmap)[:, 1] - 5.0).max())
        for more in ({}, {"cost_check_points": [0.0, -0.2, 1.0]})
    ]
    assert 0.01 < offset[0] < offset[1]


def test_footprints_stay_free_where_poses_are_added() -> None:
    costmap = empty()
    costmap.data[90:98, 70:76] = 254
    costmap.data[84:104, 64:82][costmap.data[84:104, 64:82] == 0] = 100
    box = Footprint(np.array([[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]]))
    x = np.linspace(2.0, 6.5, 46)
    y = 4.85 + 0.5 * np.exp(-(((x - 3.65) / 0.5) ** 2))
    path = Path(np.column_stack((x, y, np.append(np.arctan2(np.diff(y), np.diff(x)), 0.0))))
    assert all(footprint_cost(costmap, box, path[i]) != 254 for i in range(len(path)))
    out = smoother(path_upsampling_factor=3, minimum_turning_radius=0.0).smooth(path, costmap, footprint=box)
    assert all(footprint_cost(costmap, box, Pose2D(*(float(v) for v in p))) != 254 for p in out.poses)


def test_yaml_of_nav2() -> None:
    values = [
        "base_smoother=nav2_constrained_smoother::ConstrainedSmoother",
        "constrained.w_cost=0.02",
        "constrained.optimizer.max_iterations=70",
    ]
    configuration = load_configuration(["turtlebot"], overrides=values)
    assert configuration.smoother is not None and configuration.smoother.cls is ConstrainedSmoother
    assert configuration.smoother.params.w_cost == 0.02
    assert configuration.smoother.params.optimizer.max_iterations == 70
