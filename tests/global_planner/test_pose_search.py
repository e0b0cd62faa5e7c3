"""The search over poses: its growing weight, its queue, and what it keeps between plans."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from navstack.core import Costmap, Footprint, GridGeometry, Pose2D
from navstack.global_planner import SmacHybridParams, SmacHybridPlanner
from navstack.global_planner._se2 import both_ends
from navstack.global_planner._se2 import search as kernels
from navstack.global_planner._se2.shape import shape_of

BOX = Footprint(np.array([[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]]))
START, GOAL = Pose2D(1.0, 3.0, 0.0), Pose2D(15.2, 3.0, 0.0)


def pocket() -> Costmap:
    """A dead end between start and goal, which the heuristic leads into: its larger cells do not see the thin wall."""
    costs = np.zeros((60, 160), np.uint8)
    costs[14:46, 141] = costs[14:16, 116:142] = costs[44:46, 116:142] = 254
    return Costmap(GridGeometry(160, 60, 0.1), costs)


def planner(**values: Any) -> SmacHybridPlanner:
    return SmacHybridPlanner(SmacHybridParams(minimum_turning_radius=1.0, smooth_path=False, **values))


@pytest.mark.slow
def test_a_long_search_raises_the_weight(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fewer states, at a cost within the greatest weight; a weight of 1 stays."""
    monkeypatch.setattr(both_ends, "FIRST", 1 << 40)
    plans = {}
    for patience in (1_000_000, 2000):
        monkeypatch.setattr(kernels, "PATIENCE", patience)
        for weight in (1.0, 1.2):
            plans[patience, weight] = planner(heuristic_weight=weight).make_plan(pocket(), START, GOAL)
    assert plans[2000, 1.0].cells_expanded == plans[1_000_000, 1.0].cells_expanded
    assert 2000 < plans[2000, 1.2].cells_expanded < 0.5 * plans[1_000_000, 1.2].cells_expanded
    assert plans[1_000_000, 1.2].cost <= plans[2000, 1.2].cost <= kernels.GREATEST * plans[2000, 1.0].cost


def test_a_plan_to_the_same_goal_keeps_the_rest_of_the_last_one() -> None:
    """From poses on it and next to it, as long as the costs that it depends on and the footprint stay."""
    costmap = Costmap(GridGeometry(2000, 120, 0.1), np.zeros((120, 2000), np.uint8))
    costmap.data[0:70, 30:34] = costmap.data[50:120, 60:64] = 254
    search = SmacHybridPlanner(SmacHybridParams(motion_model_for_search="REEDS_SHEPP", minimum_turning_radius=0.6))
    goal = Pose2D(9.0, 2.0, 1.0)
    first = search.make_plan(costmap, Pose2D(1.0, 2.0, 0.0), goal)
    assert first.cells_expanded > 0
    for k, aside, turn in ((5, 0.0, 0.0), (25, 0.04, 0.05), (40, -0.04, -0.05)):
        pose = first.path[k]
        start = Pose2D(pose.x - aside * np.sin(pose.yaw), pose.y + aside * np.cos(pose.yaw), pose.yaw + turn)
        plan = search.make_plan(costmap, start, goal)
        assert plan.cells_expanded == 0
        assert plan.path[0] == start
        assert plan.path[-1] == goal
        fresh = SmacHybridPlanner(search.params).make_plan(costmap, start, goal)
        assert plan.cost <= 1.05 * fresh.cost
    costmap.data[60, 1990] = 254  # far away
    assert search.make_plan(costmap, first.path[41], goal).cells_expanded == 0
    costmap.data[90, 40] = 254
    assert search.make_plan(costmap, first.path[42], goal).cells_expanded > 0
    assert search.make_plan(costmap, first.path[43], goal, footprint=BOX).cells_expanded > 0


def test_a_padded_robot_radius_keeps_its_center_out_of_inscribed_cells() -> None:
    """As without padding; its polygon with corners is not checked."""
    assert shape_of(Footprint.from_radius(0.2, 0.01), 0.05).corners == 0


def test_the_obstacle_heuristic_needs_no_more_room_than_its_open_cells() -> None:
    """Entries that count no more are taken out of its lists where there is no room left; the values stay the same."""
    costs = np.random.default_rng(7).choice(np.array([0, 120, 250, 254, 255], np.uint8), (90, 110))
    start, goal = (3.5, 4.5), (104.5, 80.5)
    costs[4, 3] = costs[80, 104] = 0
    values, entries = [], []
    for room in (0, 100):
        engine = planner(downsample_obstacle_heuristic=False)._engine(0.1)
        engine.costs = costs
        engine.set_goal(*goal, start, keep=False)
        # with less room, one for each cell that is open at once remains
        engine._front = engine._front[: len(engine._front) if room == 0 else entries[0] - room]
        values.append(
            [engine.obstacle_cost(x + 0.5, y + 0.5) for y in range(90) for x in range(110) if costs[y, x] < 253]
        )
        entries.append(int(engine.settings["front_used"][0]))
    assert values[0] == values[1]
    assert entries[1] == entries[0] - 100
