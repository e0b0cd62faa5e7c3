"""Curves that compete by length, reversing and cusps."""

from __future__ import annotations

import math

import numpy as np
import pytest

from navstack.core import Pose2D
from navstack.global_planner._curves import (
    advance,
    changes_of_direction,
    cheapest_curve,
    dubins_curve,
    reeds_shepp_curve,
)


def cheapest(
    goal: tuple[float, float, float], cusp: float, backward: float, ends: tuple[int, int] = (0, 0)
) -> tuple[float, int, tuple[float, ...]]:
    """Cost, cusps and signed lengths of the curve that is chosen; it is checked that it ends at the goal."""
    count, kinds, lengths, best = cheapest_curve(*goal, cusp, backward, ends, math.inf)
    x, y, yaw = 0.0, 0.0, 0.0
    for kind, size in zip(kinds[:count], lengths[:count], strict=True):
        x, y, yaw = advance(kind, x, y, yaw, size, 1.0)
    assert (x, y, math.remainder(yaw - goal[2], 2.0 * math.pi)) == pytest.approx((goal[0], goal[1], 0.0), abs=1e-6)
    changes = int(changes_of_direction(lengths, ends))
    cost = sum(abs(s) * (backward if s < 0.0 else 1.0) for s in lengths) + cusp * changes
    assert best == pytest.approx(cost)
    assert cheapest_curve(*goal, cusp, backward, ends, cost + 1e-6)[:3] == (count, kinds, lengths)
    assert cheapest_curve(*goal, cusp, backward, ends, 0.9 * cost)[3] >= 0.9 * cost
    return cost, changes, lengths[:count]


def test_the_choice_between_lengths_and_cusps() -> None:
    rng = np.random.default_rng(4)
    for _ in range(300):
        goal = (float(rng.uniform(-5.0, 5.0)), float(rng.uniform(-5.0, 5.0)), float(rng.uniform(-math.pi, math.pi)))
        origin, there = Pose2D(0.0, 0.0, 0.0), Pose2D(*goal)
        costs = [cheapest(goal, cusp, 1.0)[0] for cusp in (0.0, 0.5, 1.0, 2.0, 100.0)]
        forward = dubins_curve(origin, there, 1.0).length
        backward = dubins_curve(there, origin, 1.0).length  # driven from its end to its start
        assert costs[0] == pytest.approx(reeds_shepp_curve(origin, there, 1.0).length, abs=1e-6)
        assert costs[-1] == pytest.approx(min(forward, backward), abs=1e-6)
        assert costs == sorted(costs)
        # without cusps a curve costs the same for any penalty: costs are concave in the price of a cusp
        assert costs[1] >= 0.5 * (costs[0] + costs[2]) - 1e-9
        assert cheapest(goal, 0.5, 2.0)[0] >= costs[1] - 1e-9
        for before, after in ((1, 1), (-1, 1), (1, -1), (-1, -1)):
            joined = cheapest(goal, 2.0, 1.0, (before, after))[0]
            assert costs[3] - 1e-9 <= joined <= costs[3] + 4.0 + 1e-9


def test_the_three_point_turn() -> None:
    """pi and two cusps, or 7 pi / 3 without: the price of a cusp decides at 2 pi / 3; one cusp takes longer than that."""
    turn = (0.0, 0.0, math.pi)
    assert cheapest(turn, 1.0, 1.0)[:2] == (pytest.approx(math.pi + 2.0), 2)
    assert cheapest(turn, 10.0, 1.0)[:2] == (pytest.approx(7.0 * math.pi / 3.0), 0)
    # driven backward at twice the cost: pi / 3 of it forward instead of 2 pi / 3
    cost, changes, lengths = cheapest(turn, 0.1, 2.0)
    assert (cost, changes) == (pytest.approx(4.0 * math.pi / 3.0 + 0.2), 2)
    assert [s > 0.0 for s in lengths] == [True, False, True]
