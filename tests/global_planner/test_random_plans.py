"""Smoothed plans on random maps: free where the plan was, with its ends, cusps and turning radius; by shapely, not by kernels."""

from __future__ import annotations

import numpy as np
import pytest

from navstack.core import Path, Pose2D
from navstack.global_planner.smoothers import (
    ConstrainedSmoother,
    ConstrainedSmootherParams,
    SimpleSmoother,
    SmoothedPlanner,
)
from navstack.plugins import GLOBAL_PLANNERS
from tests.global_planner.check_smoothed import between, check, random_cases
from tests.global_planner.test_smoothers import empty


@pytest.mark.slow
def test_smoothed_plans() -> None:
    """No faults by shapely and closed forms, and most plans become smoother, at least in parts."""
    tallies, found = check(random_cases(16, 5, ("astar", "smac_hybrid RS raw")))
    assert found == []
    for name, least in (("simple", 9), ("savitzky_golay", 11), ("constrained", 12)):
        assert tallies[name].changed >= least, name


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
