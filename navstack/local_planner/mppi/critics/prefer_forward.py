# pyright: basic
"""Penalizes driving backward."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from navstack.core import kernel
from navstack.local_planner.mppi.batch import Batch, Floats
from navstack.local_planner.mppi.trajectory_critic import TrajectoryCritic, TrajectoryCriticParams
from navstack.plugins import CRITICS, ParamModel, param


class PreferForwardCriticParams(TrajectoryCriticParams):
    """Weight, and where the critic is used."""

    cost_weight: float = param(5.0, "weight of the score", ge=0.0)
    threshold_to_consider: float = param(0.5, "used while more than this is left of the path", unit="m", ge=0.0)


@CRITICS.register("PreferForwardCritic", aliases=("mppi/critics/PreferForwardCritic",))
class PreferForwardCritic(TrajectoryCritic):
    """Distance driven backward (m)."""

    Params: ClassVar[type[ParamModel]] = PreferForwardCriticParams

    def score_batch(self, batch: Batch, out: Floats) -> bool:
        """Write one distance (m) per trajectory to `out`, shape (n,)."""
        if self.context.length < self.params.threshold_to_consider:
            return False
        backward_scores(batch.speeds, np.float32(batch.dt), out)
        return True


# --- kernels --------------------------------------------------------------------------------------------------------

f32 = np.float32


@kernel
def backward_scores(speeds, dt, out):
    """Distance driven backward (m)."""
    out[:] = f32(0.0)
    for t in range(speeds.shape[1]):
        row = speeds[0, t]
        for k in range(len(out)):
            out[k] += max(-row[k], f32(0.0)) * dt
