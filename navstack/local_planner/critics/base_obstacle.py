"""Keeps the robot's centre out of costs (BaseObstacleCritic of Nav2's dwb_critics; move_base scores the outline instead)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from navstack.core import INSCRIBED
from navstack.core.parameters import ParamModel, param
from navstack.interfaces import Critic, Rollouts, ScoringContext
from navstack.plugins import CRITICS

HITS, LEAVES = -6.0, -4.0


class BaseObstacleParams(ParamModel):
    """Weight, and how costs along the way add up."""

    scale: float = param(0.02, "weight of this critic", ge=0.0)
    sum_scores: bool = param(False, "sum of the costs along the trajectory instead of that of its last point")


@CRITICS.register("base_obstacle", aliases=("dwb_critics/BaseObstacleCritic", "BaseObstacle"))
class BaseObstacleCritic(Critic):
    """The cost of the centre's cell; rejects a centre on inscribed, lethal or unknown cells. For round robots: it is fast."""

    Params: ClassVar[type[ParamModel]] = BaseObstacleParams
    CODES: ClassVar[dict[int, str]] = {
        -6: "centre on an inscribed, lethal or unknown cell",
        -4: "centre off the map",
    }

    def __init__(self, name: str, params: BaseObstacleParams) -> None:
        super().__init__(name, params)
        self._context: ScoringContext | None = None

    @property
    def scale(self) -> float:
        """`scale`."""
        return self.params.scale

    def prepare(self, context: ScoringContext) -> None:
        """Takes the costmap of this cycle."""
        self._context = context

    def score(self, rollouts: Rollouts, alive: NDArray[np.bool_]) -> NDArray[np.float64]:
        """(K,) costs in 0..252 (their sum with `sum_scores`), -6 or -4, whichever comes first along the way."""
        if self._context is None:
            raise RuntimeError("prepare was not called")
        costmap = self._context.costmap
        g = costmap.geometry
        k, t = rollouts.poses.shape[:2]
        points = np.arange(t)
        valid = (points < rollouts.counts[:, None]) & alive[:, None]
        # what lies beyond a trajectory's end may be anything
        xy = np.where(valid[:, :, None], rollouts.poses[:, :, :2], (g.origin_x - g.resolution, g.origin_y))
        cells = np.floor((xy - (g.origin_x, g.origin_y)) / g.resolution)
        inside = np.all((cells >= 0) & (cells < (g.nx, g.ny)), axis=2, keepdims=True)[:, :, 0]
        ix, iy = np.where(inside[:, :, np.newaxis], cells, 0).astype(np.int64).transpose(2, 0, 1)
        costs = np.where(valid & inside, costmap.data[iy, ix].astype(np.float64), 0.0)
        wrong = np.where(valid & ~inside, LEAVES, np.where(costs >= INSCRIBED, HITS, 0.0))
        last = np.maximum(rollouts.counts - 1, 0)
        out = costs.sum(axis=1) if self.params.sum_scores else costs[np.arange(k), np.minimum(last, max(t - 1, 0))]
        first = (wrong < 0.0).argmax(axis=1)
        found = wrong[np.arange(k), first]
        return np.where(found < 0.0, found, out)
