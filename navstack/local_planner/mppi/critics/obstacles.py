"""The obstacle critic of Nav2's first releases: distances to obstacles, computed from the inflated costs."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from navstack.local_planner.mppi.batch import Batch, Floats
from navstack.local_planner.mppi.collisions import CollisionTest, table
from navstack.local_planner.mppi.trajectory_critic import TrajectoryCritic, TrajectoryCriticParams
from navstack.plugins import CRITICS, ParamModel, RejectionDetail, param


class ObstaclesCriticParams(TrajectoryCriticParams):
    """Weights of obstacles near and far, and how collisions are found."""

    consider_footprint: bool = param(
        False,
        "check the footprint where the center's cost does not exclude a collision; otherwise the robot counts as round",
        ros_differs="a local costmap without inflation layer: the footprint is always checked, everywhere",
    )
    repulsion_weight: float = param(1.5, "weight of the distance to obstacles within the inflation radius", ge=0.0)
    critical_weight: float = param(20.0, "weight of the distance within collision_margin_distance", ge=0.0)
    collision_cost: float = param(100000.0, "score of a trajectory that collides", ge=0.0)
    collision_margin_distance: float = param(
        0.10, "distance to obstacles within which critical_weight counts", unit="m", ge=0.0
    )
    near_goal_distance: float = param(
        0.5, "repulsion_weight does not count while less than this is left of the path", unit="m", ge=0.0
    )
    inflation_layer_name: str = param("", "no effect: the layer that inflates the local costmap is used")


@CRITICS.register("ObstaclesCritic", aliases=("mppi/critics/ObstaclesCritic",))
class ObstaclesCritic(TrajectoryCritic):
    """How near the trajectory comes to obstacles (m, over all points); `collision_cost` for a collision."""

    Params: ClassVar[type[ParamModel]] = ObstaclesCriticParams

    @property
    def weight(self) -> float:
        """The two weights are part of the score."""
        return 1.0

    def score_batch(self, batch: Batch, out: Floats) -> bool:
        """Weighted sum of both parts."""
        p, context = self.params, self.context
        test = self._test = CollisionTest.of(context, consider_footprint=p.consider_footprint)
        self._batch = batch
        margin, repulsion = np.zeros((2, 256)), np.zeros((2, 256))
        if context.inflation is not None and context.inflation.cost_scaling_factor > 0.0:
            inflation = context.inflation
            costs = np.arange(1.0, 256.0)
            # from the footprint's edge; from the center the inscribed radius is part of the distance
            beyond = np.log(253.0 / costs) / inflation.cost_scaling_factor
            edge = beyond + inflation.inscribed_radius
            for row, distance in ((0, beyond), (1, edge)):
                margin[row, 1:] = np.maximum(p.collision_margin_distance - distance, 0.0)
                repulsion[row, 1:] = inflation.inflation_radius - distance
        near_goal = context.length < p.near_goal_distance
        collided = test.scores(batch, 1, table(margin[0], margin[1]), out)
        out[collided] = p.collision_cost
        batch.all_collided = batch.all_collided or bool(collided[: batch.number].all())
        out *= np.float32(p.critical_weight)
        if not near_goal:
            far = np.empty_like(out)
            test.scores(batch, 1, table(repulsion[0], repulsion[1]), far)
            far -= far[: batch.number].min()
            out += np.float32(p.repulsion_weight / batch.points.shape[1]) * far
        return True

    def explain(self, row: int) -> RejectionDetail:
        """Where a trajectory of the last batch collides."""
        return self._test.detail(self._batch, row, 1)
