"""Nav2's NavFn and Theta* on random maps: what is reachable is found, along free cells."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy import ndimage

from navstack.core import Costmap, GridGeometry, NoValidPathError, PlanningError, Pose2D
from navstack.global_planner import (
    Nav2NavfnParams,
    Nav2NavfnPlanner,
    Nav2ThetaStarParams,
    Nav2ThetaStarPlanner,
    NavfnParams,
    NavfnROS,
)
from navstack.global_planner.navfn import _round_half_up  # pyright: ignore[reportPrivateUsage]

N, RESOLUTION = 24, 0.05
SEEDS = st.integers(0, 2**32 - 1)


def random_map(rng: np.random.Generator) -> Costmap:
    costs = rng.choice(np.array([0, 0, 0, 40, 180, 252, 253, 254, 255], np.uint8), (N, N))
    return Costmap(GridGeometry(N, N, RESOLUTION, *rng.uniform(-3.0, 3.0, 2).tolist()), costs, "map")


def corner(costmap: Costmap, ix: int, iy: int, yaw: float = 0.0) -> Pose2D:
    """A fifth of a cell from the corner, which belongs to this cell for both ROS 1 and Nav2."""
    g = costmap.geometry
    return Pose2D(g.origin_x + (ix + 0.2) * g.resolution, g.origin_y + (iy + 0.2) * g.resolution, yaw)


@pytest.mark.slow
@settings(max_examples=60)
@given(SEEDS, st.booleans())
def test_navfn_finds_what_the_one_of_ros_finds(seed: int, unknown: bool) -> None:
    """The same potential and the same points, where the cells of start and goal are the same."""
    rng = np.random.default_rng(seed)
    costmap = random_map(rng)
    (sx, sy), (gx, gy) = rng.integers(1, N - 1, (2, 2)).tolist()
    costmap.data[sy, sx] = costmap.data[gy, gx] = 0
    start, goal = corner(costmap, sx, sy), corner(costmap, gx, gy, 1.0)
    nav2, ros = (
        Nav2NavfnPlanner(Nav2NavfnParams(tolerance=0.0, allow_unknown=unknown)),
        NavfnROS(NavfnParams(allow_unknown=unknown)),
    )
    if (sx, sy) == (gx, gy):
        assert len(nav2.make_plan(costmap, start, goal).path) == 1
        return
    try:
        theirs = ros.make_plan(costmap, start, goal, keep_potential=True)
    except PlanningError:
        with pytest.raises(NoValidPathError):
            nav2.make_plan(costmap, start, goal)
        return
    ours = nav2.make_plan(costmap, start, goal, keep_potential=True)
    assert ours.potential is not None and theirs.potential is not None
    np.testing.assert_array_equal(ours.potential, theirs.potential)
    assert ours.cost == theirs.cost and tuple(ours.goal) == tuple(goal)
    # ROS 1 appends the goal; Nav2 replaces the last point, here a fifth of a cell away
    np.testing.assert_array_equal(ours.path.poses[:-1, :2], theirs.path.poses[: len(ours.path) - 1, :2])
    assert len(theirs.path) - len(ours.path) in (0, 1)


@pytest.mark.slow
@settings(max_examples=60)
@given(SEEDS)
@example(134669345)  # 535 by Dijkstra, 450 by A*
def test_astar_of_navfn_reaches_what_dijkstra_reaches(seed: int) -> None:
    """Both stop at the first arrival, which need not be the cheapest, so neither's cost bounds that of the other."""
    rng = np.random.default_rng(seed)
    costmap = random_map(rng)
    costmap.data[costmap.data >= 253] = rng.choice(np.array([0, 254], np.uint8))
    (sx, sy), (gx, gy) = rng.integers(1, N - 1, (2, 2)).tolist()
    costmap.data[sy, sx] = costmap.data[gy, gx] = 0
    if (sx, sy) == (gx, gy):
        return
    costs: list[float] = []
    for astar in (False, True):
        planner = Nav2NavfnPlanner(Nav2NavfnParams(tolerance=0.0, use_astar=astar, max_cycles_factor=100))
        try:
            costs.append(planner.make_plan(costmap, corner(costmap, sx, sy), corner(costmap, gx, gy)).cost)
        except NoValidPathError:
            costs.append(math.inf)
    assert (costs[0] < math.inf) == (costs[1] < math.inf)


@settings(max_examples=60)
@given(SEEDS)
def test_the_tolerance_gives_the_nearest_reachable_point(seed: int) -> None:
    rng = np.random.default_rng(seed)
    costmap = random_map(rng)
    costmap.data[1:-1, 1:-1] = np.where(rng.random((N - 2, N - 2)) < 0.3, 254, 0)
    (sx, sy), (gx, gy) = rng.integers(2, N - 2, (2, 2)).tolist()
    start, goal = corner(costmap, sx, sy), corner(costmap, gx, gy)
    if (sx, sy) == (gx, gy):
        return
    costmap.data[gy, gx] = 254
    try:
        found = Nav2NavfnPlanner(Nav2NavfnParams(tolerance=0.2)).make_plan(costmap, start, goal, keep_potential=True)
    except NoValidPathError:
        return
    assert found.goal_moved_m > 0.0 and found.notes and found.potential is not None
    g = costmap.geometry
    reached = np.argwhere(np.isfinite(found.potential))
    away = np.hypot(*(reached[:, ::-1] + 0.2 - [gx + 0.2, gy + 0.2]).T)
    assert found.goal_moved_m <= away.min() * g.resolution + 1e-9


@pytest.mark.slow
@settings(max_examples=80)
@given(SEEDS, st.sampled_from([4, 8]), st.booleans())
def test_theta_star_finds_what_is_reachable(seed: int, corners: int, unknown: bool) -> None:
    """By steps to 4 or 8 neighbors, also between two blocked cells; no gap between two poses is longer than two cells."""
    rng = np.random.default_rng(seed)
    costmap = random_map(rng)
    (sx, sy), (gx, gy) = rng.integers(0, N, (2, 2)).tolist()
    costmap.data[sy, sx] = costmap.data[gy, gx] = 0
    blocked = (costmap.data == 253) | (costmap.data == 254) | ((costmap.data == 255) & (not unknown))
    groups = ndimage.label(~blocked, np.ones((3, 3)) if corners == 8 else None)[0]  # pyright: ignore
    params = Nav2ThetaStarParams(how_many_corners=corners, allow_unknown=unknown)
    start, goal = corner(costmap, sx, sy), corner(costmap, gx, gy, -2.0)
    if groups[sy, sx] != groups[gy, gx]:
        with pytest.raises(PlanningError):
            Nav2ThetaStarPlanner(params).make_plan(costmap, start, goal)
        return
    plan = Nav2ThetaStarPlanner(params).make_plan(costmap, start, goal)
    poses = plan.path.poses
    assert poses[-1, 2] == -2.0 and plan.goal_moved_m <= RESOLUTION
    if (sx, sy) == (gx, gy):
        return
    np.testing.assert_allclose(poses[[0, -1], :2], [costmap.geometry.cell_to_world(*c) for c in ((sx, sy), (gx, gy))])
    assert np.hypot(*np.diff(poses[:, :2], axis=0).T).max() < 2.0 * RESOLUTION + 1e-9
    costs = [costmap.cost_at(float(x), float(y)) for x, y in poses[:, :2]]
    assert all(cost is not None for cost in costs)
    straight = math.hypot(gx - sx, gy - sy)
    assert plan.cost >= straight


def test_rounding_of_cells() -> None:
    """Halves upwards; the number before one half down, although adding one half rounds it up."""
    below = np.nextafter(0.5, 0.0)
    assert [_round_half_up(v) for v in (0.0, 0.4, below, 0.5, 1.5, 2.5)] == [0, 0, 0, 1, 2, 3]
    assert math.floor(below + 0.5) == 1


def test_a_start_at_the_upper_border() -> None:
    """In the last half cell the nearest corner is outside the map: the cell on the border counts."""
    costmap = Costmap(GridGeometry(10, 10, 0.1), np.zeros((10, 10), np.uint8), "map")
    plan = Nav2NavfnPlanner().make_plan(costmap, Pose2D(0.97, 0.5), Pose2D(0.3, 0.5))
    assert plan.path.poses[0, :2] == pytest.approx((0.9, 0.5))
    moved = Nav2NavfnPlanner().make_plan(costmap, Pose2D(0.3, 0.5), Pose2D(0.97, 0.5))
    assert 0.0 < moved.goal_moved_m <= 0.2 + 1e-9 and moved.notes
