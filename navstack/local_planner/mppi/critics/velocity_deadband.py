# pyright: basic
"""Penalizes speeds too low for the motors."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import field_validator

from navstack.core import kernel
from navstack.local_planner.mppi.batch import Batch, Floats
from navstack.local_planner.mppi.trajectory_critic import TrajectoryCritic, TrajectoryCriticParams
from navstack.plugins import CRITICS, ParamModel, param


class VelocityDeadbandCriticParams(TrajectoryCriticParams):
    """Weight and dead band."""

    cost_weight: float = param(35.0, "weight of the score", ge=0.0)
    deadband_velocities: list[float] = param(
        [0.0, 0.0, 0.0], "speeds along x and y (m/s) and turning speed (rad/s) below which the base does not move"
    )

    @field_validator("deadband_velocities")
    @classmethod
    def _check_bands(cls, value: list[float]) -> list[float]:
        if len(value) != 3:
            raise ValueError(f"deadband_velocities needs three speeds, for vx, vy and wz, not {len(value)}")
        return value


@CRITICS.register("VelocityDeadbandCritic", aliases=("mppi/critics/VelocityDeadbandCritic",))
class VelocityDeadbandCritic(TrajectoryCritic):
    """How far the speeds are below the dead band, times the time."""

    Params: ClassVar[type[ParamModel]] = VelocityDeadbandCriticParams

    def score_batch(self, batch: Batch, out: Floats) -> bool:
        """Write what each trajectory is below the dead band by (m and rad, summed over time) to `out`, shape (n,)."""
        bands = np.abs(np.array(self.params.deadband_velocities, np.float32))
        deadband_scores(batch.speeds, bands, self.context.motion.omni, np.float32(batch.dt), out)
        return True


# --- kernels --------------------------------------------------------------------------------------------------------

f32 = np.float32


@kernel
def deadband_scores(speeds, bands, omni, dt, out):
    """How far the speeds are below `bands` (3,), times the duration."""
    out[:] = f32(0.0)
    for t in range(speeds.shape[1]):
        for axis in range(3):
            if axis == 1 and not omni:
                continue
            row, band = speeds[axis, t], bands[axis]
            for k in range(len(out)):
                out[k] += max(band - abs(row[k]), f32(0.0)) * dt
