"""Keeps the robot's centre off obstacles (BaseObstacleCritic of Nav2's dwb_critics; move_base scores the footprint)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from navstack.core.parameters import ParamModel, param
from navstack.interfaces import Critic, Rollouts, ScoringContext
from navstack.local_planner.critics._kernels import centre_costs
from navstack.local_planner.rollouts import shared_cells
from navstack.plugins import CRITICS


class BaseObstacleParams(ParamModel):
    """Weight, and how the costs along a rollout are combined."""

    scale: float = param(1.0, "weight of this critic; Nav2's own configurations use 0.02", ge=0.0)
    sum_scores: bool = param(False, "sum of the costs along the trajectory instead of the cost of its last point")


@CRITICS.register("base_obstacle", aliases=("dwb_critics/BaseObstacleCritic", "BaseObstacle"))
class BaseObstacleCritic(Critic):
    """Cost of the centre's cell; rejects a centre on inscribed, lethal or unknown cells. Fast, and exact for round robots."""

    Params: ClassVar[type[ParamModel]] = BaseObstacleParams
    CODES: ClassVar[dict[int, str]] = {
        -6: "centre on an inscribed, lethal or unknown cell",
        -4: "centre off the map",
    }

    def __init__(self, name: str, params: BaseObstacleParams) -> None:
        super().__init__(name, params)
        self._context: ScoringContext | None = None
        self._out = np.empty(0)

    @property
    def scale(self) -> float:
        """`scale`."""
        return self.params.scale

    def prepare(self, context: ScoringContext) -> None:
        """Store the costmap of this cycle."""
        self._context = context

    def score(self, rollouts: Rollouts) -> NDArray[np.float64]:
        """(K,) costs in 0..252 (their sum with `sum_scores`), -6 or -4, whichever comes first along the rollout."""
        if self._context is None:
            raise RuntimeError("prepare was not called")
        if len(self._out) != len(rollouts.counts):
            self._out = np.empty(len(rollouts.counts))
        cells = shared_cells(self._context, rollouts)
        costs = self._context.costmap.data
        centre_costs(costs, cells.flat, rollouts.counts, rollouts.alive, self.params.sum_scores, self._out)
        return self._out
