"""The search over poses: its growing weight, its queue, and what it keeps between plans."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from navstack.core import Costmap, GridGeometry, Pose2D
from navstack.global_planner import SmacHybridParams, SmacHybridPlanner
from navstack.global_planner._se2 import _search_kernels as kernels

START, GOAL = Pose2D(1.0, 3.0, 0.0), Pose2D(15.2, 3.0, 0.0)


def pocket() -> Costmap:
    """A dead end between start and goal, which the heuristic leads into: its larger cells do not see the thin wall."""
    costs = np.zeros((60, 160), np.uint8)
    costs[14:46, 141] = costs[14:16, 116:142] = costs[44:46, 116:142] = 254
    return Costmap(GridGeometry(160, 60, 0.1), costs)


def planner(**values: Any) -> SmacHybridPlanner:
    return SmacHybridPlanner(SmacHybridParams(minimum_turning_radius=1.0, smooth_path=False, **values))


def test_a_long_search_raises_the_weight(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fewer states, at a cost within the greatest weight; a weight of 1 stays."""
    plans = {}
    for patience in (1_000_000, 2000):
        monkeypatch.setattr(kernels, "PATIENCE", patience)
        for weight in (1.0, 1.2):
            plans[patience, weight] = planner(heuristic_weight=weight).make_plan(pocket(), START, GOAL)
    assert plans[2000, 1.0].cells_expanded == plans[1_000_000, 1.0].cells_expanded
    assert 2000 < plans[2000, 1.2].cells_expanded < 0.5 * plans[1_000_000, 1.2].cells_expanded
    assert plans[1_000_000, 1.2].cost <= plans[2000, 1.2].cost <= kernels.GREATEST * plans[2000, 1.0].cost
