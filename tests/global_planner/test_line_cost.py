"""The cost of straight lines: jumps over cells of the least weight change nothing; planners' lines cost what their cells do."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from navstack.core import Costmap, GridGeometry, Pose2D
from navstack.global_planner import AStarParams, AStarPlanner, ThetaStarParams, ThetaStarPlanner
from navstack.global_planner._search import best_first as kernels
from navstack.global_planner._search.best_first import SETTINGS

NX, NY = 70, 60


def scattered(rng: np.random.Generator, share: float) -> NDArray[np.uint8]:
    """(NY, NX) free cells, and a share of cells with other costs, half of them blocked."""
    cells = np.zeros((NY, NX), np.uint8)
    others = rng.random((NY, NX)) < share
    cells[others] = np.where(rng.random(others.sum()) < 0.5, 254, rng.integers(1, 252, others.sum()))
    return cells


def brute_force_clearance(is_least: NDArray[np.bool_], window: tuple[int, int, int, int]) -> NDArray[np.uint8]:
    """Rings around every cell that contain only cells of the least weight inside the inner part of the window."""
    x0, y0, x1, y1 = window
    inside = np.zeros_like(is_least)
    inside[y0 + 1 : y1 - 1, x0 + 1 : x1 - 1] = is_least[y0 + 1 : y1 - 1, x0 + 1 : x1 - 1]
    out = np.zeros(is_least.shape, np.uint8)
    for y, x in np.argwhere(inside):
        d = 0
        while inside[y - d : y + d + 1, x - d : x + d + 1].all():
            d += 1
        out[y, x] = d
    return out


@pytest.mark.parametrize("window", [(0, 0, NX, NY), (5, 9, 61, 44), (3, 3, 5, 5)])
def test_the_clearance_is_that_of_brute_force(window: tuple[int, int, int, int]) -> None:
    cells = scattered(np.random.default_rng(3), 0.02)
    weights = 1.0 + np.arange(256.0)
    clear = np.zeros(NX * NY, np.uint8)
    kernels.measure_clearance(cells.reshape(-1), weights, 1.0, NX, np.array(window), clear)
    assert (clear.reshape(NY, NX) == brute_force_clearance(cells == 0, window)).all()


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.0, 0.01, 0.1])
@pytest.mark.parametrize("cut_corners", [0, 1])
def test_jumps_do_not_change_the_cost_of_a_line(share: float, cut_corners: int) -> None:
    """2,000 lines, half of them diagonal, straight or of slope 1/3, which pass through corners; tolerance: rounding."""
    rng = np.random.default_rng(int(share * 100) + cut_corners)
    cells = scattered(rng, share)
    weights = 50.0 + 0.8 * np.arange(256.0)
    weights[254] = np.inf
    clear, unknown = np.zeros(NX * NY, np.uint8), np.zeros(NX * NY, np.uint8)
    kernels.measure_clearance(cells.reshape(-1), weights, 50.0, NX, np.array((2, 2, NX - 9, NY)), clear)
    settings = np.zeros(1, SETTINGS)
    settings[["nx", "ny", "start", "cut_corners"]] = (NX, NY, 777, cut_corners)
    settings[["start_weight", "least"]] = (50.0, 50.0)
    finite = 0
    for i in range(2000):
        ax, ay, bx, by = (int(v) for v in rng.integers(0, (NX, NY, NX, NY)))
        if i % 2:
            dx, dy = ((1, 1), (1, -1), (3, 1), (1, -3), (0, 1), (1, 0))[i // 2 % 6]
            n = int(rng.integers(1, 20))
            bx, by = min(max(ax + n * dx, 0), NX - 1), min(max(ay + n * dy, 0), NY - 1)
        args = cells.reshape(-1), weights
        slow = kernels.line_cost(*args, unknown, settings[0], ax, ay, bx, by, np.inf)
        fast = kernels.line_cost(*args, clear, settings[0], ax, ay, bx, by, np.inf)
        assert fast == pytest.approx(slow, rel=1e-12)
        finite += np.isfinite(slow)
        if np.isfinite(slow):
            limited = kernels.line_cost(*args, clear, settings[0], ax, ay, bx, by, slow * 0.999)
            assert limited > slow * 0.999 or slow == 0.0
    assert finite > 500


def test_a_line_through_free_cells_costs_its_length() -> None:
    clear = np.zeros(NX * NY, np.uint8)
    cells = np.zeros(NX * NY, np.uint8)
    weights = np.full(256, 3.0)
    kernels.measure_clearance(cells, weights, 3.0, NX, np.array((0, 0, NX, NY)), clear)
    settings = np.zeros(1, SETTINGS)
    settings[["nx", "ny", "start", "start_weight", "least"]] = (NX, NY, 0, 3.0, 3.0)
    assert kernels.line_cost(cells, weights, clear, settings[0], 4, 5, 44, 35, np.inf) == 150.0


def test_a_blocked_start_is_left_only() -> None:
    """The search runs from the start if the start is blocked, from the goal otherwise: both find the same way out."""
    cells = np.zeros((40, 40), np.uint8)
    cells[10:30, 20] = 254
    costmap = Costmap(GridGeometry(40, 40, 1.0), cells)
    goal = Pose2D(35.5, 20.5)
    free, blocked = costmap, Costmap(costmap.geometry, cells.copy())
    blocked.data[20, 5] = 253
    octile = AStarPlanner(AStarParams(neutral_cost=1.0, cost_factor=0.0)).make_plan(free, Pose2D(5.5, 20.5), goal)
    for heuristic_weight, worse in ((1.0, 1.0 + 1e-9), (1.5, 1.5)):
        params = ThetaStarParams(
            neutral_cost=1.0, cost_factor=0.0, start_policy="clear_cell", heuristic_weight=heuristic_weight
        )
        a = ThetaStarPlanner(params).make_plan(free, Pose2D(5.5, 20.5), goal)
        b = ThetaStarPlanner(params).make_plan(blocked, Pose2D(5.5, 20.5), goal)
        assert max(a.cost, b.cost) <= min(a.cost, b.cost) * worse
        assert min(a.cost, b.cost) < 0.97 * octile.cost
