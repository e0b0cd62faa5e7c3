"""Random pairs are planned from scratch, without the caches of the planner."""

from __future__ import annotations

import numpy as np

from navstack.core import Costmap, GridGeometry
from navstack.global_planner import NavfnROS
from navstack.studies.planners import reachable_pairs, reset_planner, run_pairs


class CountingPlanner(NavfnROS):
    """Counts its resets."""

    resets = 0

    def reset(self) -> None:
        self.resets += 1
        super().reset()


def test_every_pair_is_planned_from_scratch() -> None:
    costmap = Costmap(GridGeometry(60, 60, 0.1), np.zeros((60, 60), np.uint8))
    (pair,) = reachable_pairs(costmap, 1)
    planner = CountingPlanner()
    first = planner.make_plan(costmap, *pair)
    assert planner.make_plan(costmap, *pair) is first  # from the cache
    reset_planner(planner)
    assert planner.make_plan(costmap, *pair) is not first
    run_pairs({"navfn": planner}, costmap, [pair, pair])
    assert planner.resets == 3
