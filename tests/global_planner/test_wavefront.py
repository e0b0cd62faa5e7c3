"""The wavefront: cost interpreters, the cells it accesses, and the arrays it reuses."""

from __future__ import annotations

import numpy as np
import pytest

from navstack.core import Costmap, GridGeometry, Pose2D
from navstack.global_planner import GlobalPlannerParams, GlobalPlannerROS, NavfnParams, NavfnROS
from navstack.global_planner._search.cells import global_planner_costs, navfn_costs
from navstack.global_planner._search.propagation import NAVFN_RISE, propagate_navfn
from navstack.global_planner._search.wave_search import CoarseHeuristic
from navstack.global_planner._search.wavefront import Wavefront


def test_navfn_costs() -> None:
    costs = navfn_costs(True)
    assert [costs.steps[c] for c in (0, 1, 2, 100, 252, 255)] == [50, 50, 51, 130, 251, 253]
    assert np.flatnonzero(costs.blocked).tolist() == [253, 254]
    assert np.flatnonzero(navfn_costs(False).blocked).tolist() == [253, 254, 255]
    assert np.isinf(costs.weights[costs.blocked]).all()


def test_global_planner_costs() -> None:
    costs = global_planner_costs(253, 50, 3.0, True, True)
    assert [costs.steps[c] for c in (0, 1, 67, 68, 251, 255)] == [50, 53, 251, 252, 252, 252]
    assert np.flatnonzero(costs.blocked).tolist() == [252, 253, 254]
    assert not global_planner_costs(255, 1, 0.01, False, True).blocked[253]


def test_a_short_query_writes_a_corner_of_a_huge_map() -> None:
    """Memory outside the open window keeps a pattern that the wave would overwrite."""
    wave = Wavefront()
    costmap = Costmap(GridGeometry(2000, 2000, 0.05))
    propagate_navfn(wave, costmap, navfn_costs(True), root=(50, 50), target=(90, 70))
    wave.pot[:] = 12345.0
    propagate_navfn(wave, costmap, navfn_costs(True), root=(50, 50), target=(90, 70))
    x0, y0, x1, y1 = wave.window
    assert (x1 - x0) * (y1 - y0) < 0.02 * costmap.data.size
    outside = wave.pot.reshape(2000, 2000).copy()
    outside[y0:y1, x0:x1] = 12345.0
    assert (outside == 12345.0).all()


def test_growth_of_the_window_does_not_affect_the_result() -> None:
    """A wave whose window grows in steps has the same result as one with the whole map open, to the bit."""
    rng = np.random.default_rng(5)
    data = rng.integers(0, 200, (400, 500)).astype(np.uint8)
    data[rng.random(data.shape) < 0.2] = 254
    costmap = Costmap(GridGeometry(500, 400, 0.05), data)
    costs = navfn_costs(True)
    stepwise, whole = Wavefront(), Wavefront()
    propagate_navfn(stepwise, costmap, costs, root=(250, 200), target=(260, 200), stop=False)
    propagate_navfn(whole, costmap, costs, root=(250, 200), target=(499, 399), stop=False)
    x0, y0, x1, y1 = whole.window
    a, b = stepwise.full_potential(), whole.full_potential()
    assert (x0, y0, x1, y1) == (0, 0, 500, 400)
    assert (a == b).all()
    assert np.isfinite(a).sum() > 100_000


def test_a_wave_can_be_resumed() -> None:
    costmap = Costmap(GridGeometry(300, 200, 0.05))
    costs = navfn_costs(True)
    once, twice = Wavefront(), Wavefront()
    propagate_navfn(once, costmap, costs, root=(20, 20), target=(280, 180))
    propagate_navfn(twice, costmap, costs, root=(20, 20), target=(100, 100))
    first = twice.full_potential()
    twice.run((280, 180))
    assert np.isfinite(first).sum() < np.isfinite(once.full_potential()).sum()
    assert (twice.full_potential() == once.full_potential()).all()


@pytest.mark.parametrize("allow_unknown", [True, False])
def test_the_coarse_heuristic_overestimates_by_a_bounded_amount(allow_unknown: bool) -> None:
    rng = np.random.default_rng(8)
    costs = navfn_costs(allow_unknown)
    for _ in range(10):
        data = rng.choice([0, 0, 30, 120, 252, 255], (120, 150)).astype(np.uint8)
        data[rng.random(data.shape) < 0.15] = 254
        data[60, :140] = 254
        costmap = Costmap(GridGeometry(150, 120, 0.05), data)
        data[5, 5] = data[110, 140] = 0
        wave = Wavefront()
        propagate_navfn(wave, costmap, costs, root=(5, 5), target=(140, 110))
        estimate = CoarseHeuristic().build(costmap, costs, (140, 110), (5, 5), NAVFN_RISE)
        true = wave.potential_of(140, 110)
        if true < np.inf:
            assert estimate <= true + 6.0 * NAVFN_RISE


def test_planners_reuse_their_arrays() -> None:
    costmap = Costmap(GridGeometry(100, 100, 0.05))
    planner = NavfnROS()
    planner.make_plan(costmap, Pose2D(1.0, 1.0), Pose2D(4.0, 4.0))
    before = planner._search.wave.pot  # pyright: ignore
    planner.make_plan(costmap, Pose2D(1.0, 1.0), Pose2D(4.0, 2.0))
    assert planner._search.wave.pot is before  # pyright: ignore


def test_outline_map_blocks_the_outermost_cells() -> None:
    data = np.full((5, 20), 254, np.uint8)
    data[0] = 0  # a corridor along the border
    costmap = Costmap(GridGeometry(20, 5, 0.1), data)
    start, goal = Pose2D(0.15, 0.05), Pose2D(1.75, 0.05)
    plan = GlobalPlannerROS(GlobalPlannerParams(outline_map=False)).make_plan(costmap, start, goal, keep_potential=True)
    assert plan.path.length == pytest.approx(1.6, abs=0.05)
    assert plan.potential is not None
    assert plan.potential.shape == data.shape


def test_visualize_potential_returns_the_potential() -> None:
    costmap = Costmap(GridGeometry(40, 40, 0.1))
    start, goal = Pose2D(1.0, 1.0), Pose2D(3.0, 3.0)
    assert NavfnROS().make_plan(costmap, start, goal).potential is None
    assert NavfnROS(NavfnParams(visualize_potential=True)).make_plan(costmap, start, goal).potential is not None
