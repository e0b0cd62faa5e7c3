# pyright: basic
"""Turns the robot to its goal's heading."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np

from navstack.core import kernel
from navstack.local_planner.mppi.batch import Batch, Floats
from navstack.local_planner.mppi.trajectory_critic import TrajectoryCritic, TrajectoryCriticParams, wrapped
from navstack.plugins import CRITICS, ParamModel, param


class GoalAngleCriticParams(TrajectoryCriticParams):
    """Weight, and where the critic is used."""

    cost_weight: float = param(3.0, "weight of the score", ge=0.0)
    threshold_to_consider: float = param(0.5, "used while less than this is left of the path", unit="m", ge=0.0)
    symmetric_yaw_tolerance: bool = param(False, "the opposite of the goal's heading counts, too")


@CRITICS.register("GoalAngleCritic", aliases=("mppi/critics/GoalAngleCritic",))
class GoalAngleCritic(TrajectoryCritic):
    """Mean angle to the goal's heading (rad)."""

    Params: ClassVar[type[ParamModel]] = GoalAngleCriticParams

    def score_batch(self, batch: Batch, out: Floats) -> bool:
        """Radians."""
        context, p = self.context, self.params
        if context.length > p.threshold_to_consider:
            return False
        heading_scores(batch.points, np.float32(context.target.yaw), p.symmetric_yaw_tolerance, out)
        return True


# --- kernels --------------------------------------------------------------------------------------------------------

f32 = np.float32


@kernel
def heading_scores(points, yaw, symmetric, out):
    """Mean angle between the headings and `yaw`; with `symmetric` also its opposite counts."""
    out[:] = f32(0.0)
    scale = f32(1.0 / points.shape[1])
    for t in range(points.shape[1]):
        row = points[2, t]
        for k in range(len(out)):
            error = wrapped(row[k] - yaw)
            if symmetric:
                error = min(error, f32(math.pi) - error)
            out[k] += error * scale
