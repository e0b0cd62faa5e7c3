"""The obstacle critic leaves out what cannot change a score: its scores are those of every point on its own."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from navstack.core import Costmap, Footprint, GridGeometry, Pose2D, RobotState, footprint_cost, overlaps_obstacle
from navstack.local_planner import DWAParams, DWAPlanner
from navstack.local_planner.critics import ObstacleCritic
from navstack.local_planner.critics.obstacle import HEADINGS, PARTS, ObstacleParams, footprint_rows
from navstack.plugins import Rollouts, ScoringContext

FOOTPRINTS = [
    Footprint.from_radius(0.25, 0.01),
    Footprint(np.array([[0.3, 0.2], [-0.2, 0.2], [-0.2, -0.2], [0.3, -0.2]])),
    Footprint(np.array([[0.5, 0.0], [-0.3, 0.25], [-0.1, 0.0], [-0.3, -0.25]])),
]
FLAT = Footprint(np.array([[0.5, 0.02], [-0.5, 0.02], [-0.5, -0.02], [0.5, -0.02]]))
LIMITS = DWAPlanner(DWAParams(max_vel_trans=0.5)).limits


@pytest.mark.slow
@settings(deadline=None, max_examples=60)
@given(
    seed=st.integers(0, 2**32 - 1),
    resolution=st.sampled_from([0.02, 0.03, 0.06]),
    lethal=st.sampled_from([0.0, 0.0005, 0.01]),
    sums=st.booleans(),
    alike=st.booleans(),
    speed=st.sampled_from([0.1, 0.3, 0.37, 0.5, 0.6]),
    footprint=st.sampled_from(FOOTPRINTS),
    central=st.booleans(),
)
def test_obstacle_scores_equal_those_of_every_point_on_its_own(
    seed: int,
    resolution: float,
    lethal: float,
    sums: bool,
    alike: bool,
    speed: float,
    footprint: Footprint,
    central: bool,
) -> None:
    """Points that cannot change the score are left out, by a bound; the cost of a common first point is computed once."""
    rng = np.random.default_rng(seed)
    g = GridGeometry(90, 80, resolution, -1.0, 0.5)
    costs = (rng.random((g.ny, g.nx)) ** 6 * 100.0).astype(np.uint8)
    costs += (np.arange(g.nx) * rng.uniform(0.0, 1.7)).astype(np.uint8)
    costs[rng.random(costs.shape) < lethal] = 254
    costs[rng.random(costs.shape) < 0.1 * lethal] = 255
    costmap = Costmap(g, costs, "odom")
    points = rng.uniform(-0.02, 1.02, (10, 1, 3)) * (g.width_m, g.height_m, 6.0) + (g.origin_x, g.origin_y, 0.0)
    points = points + np.linspace(0.0, 1.0, 12)[:, None] * rng.uniform(-0.3, 0.3, (10, 1, 3))
    if alike:
        points = points[:1] + np.linspace(0.0, 1.0, 12)[:, None] * rng.uniform(0.0, 0.3, (10, 1, 3))
        points[:, 0] = (g.origin_x + 40 * resolution, g.origin_y + 30 * resolution, 0.0)  # corners on borders of cells
    if central:  # far from the border, where the cells that a footprint can touch are known
        middle = np.array((g.origin_x + 0.5 * g.width_m, g.origin_y + 0.5 * g.height_m))
        points[..., :2] = middle + 0.05 * (points[..., :2] - middle)
    rollouts = Rollouts(np.tile((speed, 0.0, 0.0), (10, 1)), points, rng.integers(1, 13, 10))
    params = ObstacleParams(sum_scores=sums, scaling_speed=0.25, max_scaling_factor=0.2)
    critic = ObstacleCritic("obstacle", params)
    state = RobotState(Pose2D(0.0, 1.0))
    critic.prepare(ScoringContext(state, costmap, footprint, np.zeros((1, 3)), Pose2D(0.0, 0.0), LIMITS))
    scores = critic.score(rollouts)
    grown = Footprint(footprint.vertices * critic.footprint_scale(speed, 0.5))
    for k, number in enumerate(rollouts.counts.tolist()):
        poses_ = [Pose2D(*point) for point in points[k, :number].tolist()]
        found = [point_cost(costmap, grown, pose) for pose in poses_]
        hits = [i for i, cost in enumerate(found) if cost >= 254]
        assert critic.first_collision[k] == (hits[0] if hits else -1)
        assert scores[k] == (-6.0 if hits else sum(found) if sums else max(found))


def point_cost(costmap: Costmap, footprint: Footprint, pose: Pose2D) -> int:
    """Cost of one point of a rollout: edges, center, overlapped lethal cells; 256 off the map."""
    center, edges = costmap.cost_at(*pose[:2]), footprint_cost(costmap, footprint, pose, interior=False)
    if center is None or edges is None:
        return 256
    return 254 if overlaps_obstacle(costmap, footprint, pose) else max(edges, center) if edges < 254 else edges


@pytest.mark.slow
@given(
    seed=st.integers(0, 2**32 - 1),
    resolution=st.sampled_from([0.02, 0.05, 0.11]),
    footprint=st.sampled_from([*FOOTPRINTS, FLAT]),
    sizes=st.sampled_from([(1.0, 1.0), (1.0, 1.05), (1.15, 1.2)]),
)
@settings(deadline=None, max_examples=50)
def test_rows_of_a_heading_contain_every_cell_that_a_footprint_touches(
    seed: int, resolution: float, footprint: Footprint, sizes: tuple[float, float]
) -> None:
    """With lethal cells everywhere but in the windows of its pose, it touches none."""
    rng = np.random.default_rng(seed)
    n = 120
    radius = math.ceil(sizes[1] * footprint.circumscribed_radius / resolution)
    rows = np.empty((HEADINGS * PARTS**2, 4 * radius + 2), np.int32)
    footprint_rows(footprint.vertices / resolution, *sizes, n, n, rows)
    grown = Footprint(footprint.vertices * rng.uniform(*sizes))
    x, y, yaw = (*rng.uniform(58.0, 62.0, 2), rng.uniform(-9.0, 9.0))
    pose = Pose2D(x * resolution, y * resolution, yaw)
    ix, iy = int(x), int(y)
    part = int((y - iy) * PARTS) * PARTS + int((x - ix) * PARTS)
    windows = rows[math.floor(yaw * HEADINGS / (2.0 * math.pi)) % HEADINGS * PARTS**2 + part].tolist()
    covered = np.zeros((n, n), np.bool_)
    for offset in windows:
        level, first = divmod(offset + iy * n + ix, n * n)
        covered.reshape(-1)[first : first + (1 << level)] = True
    g = GridGeometry(n, n, resolution)
    costs = np.zeros((n, n), np.uint8)
    costs[~covered] = 254
    assert footprint_cost(Costmap(g, costs, "odom"), grown, pose, interior=False) == 0
    assert not overlaps_obstacle(Costmap(g, costs, "odom"), grown, pose)
