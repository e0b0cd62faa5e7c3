# pyright: basic
"""Penalizes turning, which keeps holonomic robots from spinning on their way."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from navstack.core import kernel
from navstack.local_planner.mppi.batch import Batch, Floats
from navstack.local_planner.mppi.trajectory_critic import TrajectoryCritic, TrajectoryCriticParams
from navstack.plugins import CRITICS, ParamModel, param


class TwirlingCriticParams(TrajectoryCriticParams):
    """Weight."""

    cost_weight: float = param(10.0, "weight of the score", ge=0.0)


@CRITICS.register("TwirlingCritic", aliases=("mppi/critics/TwirlingCritic",))
class TwirlingCritic(TrajectoryCritic):
    """Mean absolute turning speed (rad/s), until the robot is within the goal checker's tolerance."""

    Params: ClassVar[type[ParamModel]] = TwirlingCriticParams

    def score_batch(self, batch: Batch, out: Floats) -> bool:
        """rad/s."""
        if self.context.length < self.context.xy_tolerance:
            return False
        turning_scores(batch.speeds, out)
        return True


# --- kernels --------------------------------------------------------------------------------------------------------

f32 = np.float32


@kernel
def turning_scores(speeds, out):
    """Mean absolute turning speed (rad/s)."""
    out[:] = f32(0.0)
    scale = f32(1.0 / speeds.shape[1])
    for t in range(speeds.shape[1]):
        row = speeds[2, t]
        for k in range(len(out)):
            out[k] += abs(row[k]) * scale
