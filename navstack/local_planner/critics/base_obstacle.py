# pyright: basic
"""Keeps the robot's center off obstacles (BaseObstacleCritic of Nav2's dwb_critics; move_base scores the footprint)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from navstack.core import Pose2D, describe_cost, kernel
from navstack.local_planner.critics.obstacle import nearest_collision, travelled
from navstack.local_planner.rollouts import shared_cells
from navstack.plugins import CRITICS, Critic, ParamModel, RejectionDetail, Rollouts, ScoringContext, param

IN_COLLISION, OFF_MAP = -6.0, -4.0


class BaseObstacleParams(ParamModel):
    """Weight, and how the costs along a rollout are combined."""

    scale: float = param(1.0, "weight of this critic; Nav2's own configurations use 0.02", ge=0.0)
    sum_scores: bool = param(False, "sum of the costs along the trajectory instead of the cost of its last point")


@CRITICS.register("base_obstacle", aliases=("dwb_critics/BaseObstacleCritic", "BaseObstacle"))
class BaseObstacleCritic(Critic[BaseObstacleParams]):
    """Cost of the center's cell; rejects a center on inscribed, lethal or unknown cells. Fast, and exact for round robots."""

    Params: ClassVar[type[ParamModel]] = BaseObstacleParams
    CODES: ClassVar[dict[int, str]] = {
        int(IN_COLLISION): "Trajectory Hits Obstacle.",
        int(OFF_MAP): "Trajectory Goes Off Grid.",
    }

    def __init__(self, name: str, params: BaseObstacleParams) -> None:
        super().__init__(name, params)
        self._context: ScoringContext | None = None
        self._rollouts: Rollouts | None = None
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
        self._rollouts = rollouts
        if len(self._out) != len(rollouts.counts):
            self._out = np.empty(len(rollouts.counts))
        cells = shared_cells(self._context, rollouts)
        costs = self._context.costmap.data
        center_costs(costs, cells.flat, rollouts.counts, rollouts.alive, self.params.sum_scores, self._out)
        return self._out

    # --- diagnostics ------------------------------------------------------------------------------------------------

    def explain(self, row: int) -> RejectionDetail:
        """Point, pose and cell of the row's first collision."""
        step = self._first_collision(row)
        if self._context is None or self._rollouts is None or step < 0:
            return RejectionDetail()
        costmap = self._context.costmap
        x, y, yaw = self._rollouts.poses[row, step].tolist()
        cell = costmap.geometry.world_to_cell(x, y)
        cost = int(costmap.data[cell[1], cell[0]]) if cell is not None else None
        reason = "center off the map" if cost is None else f"center on {describe_cost(cost)}"
        return RejectionDetail(reason, step, Pose2D(x, y, yaw), travelled(self._rollouts, row, step), cell, cost)

    def nearest_rejection(self, rows: NDArray[np.intp]) -> int:
        """The row that travels the shortest distance before its collision."""
        assert self._rollouts is not None
        first = np.array([self._first_collision(row) for row in rows.tolist()])
        return nearest_collision(self._rollouts, rows, first)

    def _first_collision(self, row: int) -> int:
        """Index of the first point of a row in collision, -1 without."""
        if self._context is None or self._rollouts is None:
            return -1
        cells = shared_cells(self._context, self._rollouts).flat[row, : self._rollouts.counts[row]]
        blocked = (cells < 0) | (self._context.costmap.data.ravel()[cells] >= 253)
        return int(blocked.argmax()) if blocked.any() else -1


@kernel
def center_costs(costs, cells, counts, alive, sum_scores, out):
    """BaseObstacleCritic of Nav2: cost at each rollout's last cell, or the sum over all its points.

    IN_COLLISION or OFF_MAP, whichever comes first.

    `cells` (K, T): flat, -1 off the map.
    """
    flat = costs.ravel()
    for k in range(len(counts)):
        if not alive[k]:
            continue
        score = 0.0
        for i in range(counts[k]):
            if cells[k, i] < 0:
                score = OFF_MAP
                break
            cost = flat[cells[k, i]]
            if cost >= 253:
                score = IN_COLLISION
                break
            score = score + cost if sum_scores else float(cost)
        out[k] = score
