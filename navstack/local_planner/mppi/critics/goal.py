# pyright: basic
"""Draws the robot to its goal."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from navstack.core import kernel
from navstack.local_planner.mppi.batch import Batch, Floats
from navstack.local_planner.mppi.trajectory_critic import TrajectoryCritic, TrajectoryCriticParams
from navstack.plugins import CRITICS, ParamModel, param


class GoalCriticParams(TrajectoryCriticParams):
    """Weight, and where the critic is used."""

    cost_weight: float = param(5.0, "weight of the score", ge=0.0)
    threshold_to_consider: float = param(1.4, "used while less than this is left of the path", unit="m", ge=0.0)


@CRITICS.register("GoalCritic", aliases=("mppi/critics/GoalCritic",))
class GoalCritic(TrajectoryCritic):
    """Mean distance to the goal (m)."""

    Params: ClassVar[type[ParamModel]] = GoalCriticParams

    def score_batch(self, batch: Batch, out: Floats) -> bool:
        """Write one distance (m) per trajectory to `out`, shape (n,)."""
        context = self.context
        if context.length > self.params.threshold_to_consider:
            return False
        x, y = context.target.x - batch.anchor[0], context.target.y - batch.anchor[1]
        distance_scores(batch.points, np.float32(x), np.float32(y), out)
        return True


# --- kernels --------------------------------------------------------------------------------------------------------

f32 = np.float32


@kernel
def distance_scores(points, x, y, out):
    """Mean distance of the points to (x, y)."""
    out[:] = f32(0.0)
    scale = f32(1.0 / points.shape[1])
    for t in range(points.shape[1]):
        px, py = points[0, t], points[1, t]
        for k in range(len(out)):
            dx, dy = px[k] - x, py[k] - y
            out[k] += np.sqrt(dx * dx + dy * dy) * scale
