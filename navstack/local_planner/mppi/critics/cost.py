"""The default obstacle critic: costs of the costmap along the trajectory, and collisions."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from navstack.local_planner.mppi.batch import Batch, Floats
from navstack.local_planner.mppi.collisions import CollisionTest, table
from navstack.local_planner.mppi.trajectory_critic import TrajectoryCritic, TrajectoryCriticParams, add_powered
from navstack.plugins import CRITICS, ParamModel, RejectionDetail, param


class CostCriticParams(TrajectoryCriticParams):
    """Weight, costs of collisions, and how they are found."""

    cost_weight: float = param(3.81, "weight of the score", ge=0.0)
    consider_footprint: bool = param(
        False,
        "check the footprint where the center's cost does not exclude a collision; otherwise the robot counts as round",
        ros_differs="a local costmap without inflation layer: the footprint is always checked, everywhere",
    )
    collision_cost: float = param(1000000.0, "score of a trajectory that collides", ge=0.0)
    critical_cost: float = param(300.0, "score of a point of at least near_collision_cost", ge=0.0)
    near_collision_cost: int = param(253, "cost of the center's cell that counts as critical", ge=1, le=255)
    near_goal_distance: float = param(
        0.5, "costs below near_collision_cost do not count while less than this is left of the path", unit="m", ge=0.0
    )
    trajectory_point_step: int = param(2, "every n-th point of a trajectory is looked at", ge=1)
    inflation_layer_name: str = param("", "no effect: the layer that inflates the local costmap is used")


@CRITICS.register("CostCritic", aliases=("mppi/critics/CostCritic",))
class CostCritic(TrajectoryCritic):
    """Mean cost under the center in units of a lethal cell; `collision_cost` for a collision."""

    Params: ClassVar[type[ParamModel]] = CostCriticParams

    def add_scores(self, batch: Batch, out: Floats, totals: Floats) -> bool:
        """As the base class; all in collision is a failure of the batch."""
        p = self.params
        points = (batch.points.shape[1] - 1) // p.trajectory_point_step + 1
        self.score_batch(batch, out)
        add_powered(out, np.float32(p.cost_weight / 254.0 / points), p.cost_power, totals)
        return True

    def score_batch(self, batch: Batch, out: Floats) -> bool:
        """Sum of the costs."""
        p, context = self.params, self.context
        costs = np.arange(256.0)
        if context.length < p.near_goal_distance:
            costs[:] = 0.0
        costs[p.near_collision_cost :] = p.critical_cost
        self._test = CollisionTest.of(context, consider_footprint=p.consider_footprint)
        collided = self._test.scores(batch, p.trajectory_point_step, table(costs), out)
        out[collided] = p.collision_cost
        batch.all_collided = batch.all_collided or bool(collided[: batch.number].all())
        self._batch = batch
        return True

    def explain(self, row: int) -> RejectionDetail:
        """Where a trajectory of the last batch collides."""
        return self._test.detail(self._batch, row, self.params.trajectory_point_step)
