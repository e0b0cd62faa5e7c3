# pyright: basic
"""Penalizes velocities beyond the limits, and turns tighter than the turning radius."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from navstack.core import kernel
from navstack.local_planner.mppi.batch import Batch, Floats
from navstack.local_planner.mppi.trajectory_critic import TrajectoryCritic, TrajectoryCriticParams, add_outside
from navstack.plugins import CRITICS, ParamModel, param


class ConstraintCriticParams(TrajectoryCriticParams):
    """Weight."""

    cost_weight: float = param(4.0, "weight of the score", ge=0.0)


@CRITICS.register("ConstraintCritic", aliases=("mppi/critics/ConstraintCritic",))
class ConstraintCritic(TrajectoryCritic):
    """Time spent beyond the velocity limits in force, times the excess (m); likewise below the turning radius."""

    Params: ClassVar[type[ParamModel]] = ConstraintCriticParams

    def score_batch(self, batch: Batch, out: Floats) -> bool:
        """Violations times time."""
        m = self.context.motion
        highest = np.array([m.vx_max, m.vy_max, m.wz_max], np.float32)
        lowest = np.array([m.vx_min, -m.vy_max, -m.wz_max], np.float32)
        constraint_scores(batch.speeds, highest, lowest, np.float32(m.min_turning_r), m.omni, np.float32(batch.dt), out)
        return True


# --- kernels --------------------------------------------------------------------------------------------------------

f32 = np.float32


@kernel
def constraint_scores(speeds, highest, lowest, radius, omni, dt, out):
    """Violations of the limits `lowest` .. `highest` (3,) of vx and vy, and of the turning radius (m), times their duration."""
    out[:] = f32(0.0)
    steps, number = speeds.shape[1], speeds.shape[2]
    for t in range(steps):
        add_outside(speeds[0, t], lowest[0], highest[0], dt, out)
        if omni:
            add_outside(speeds[1, t], lowest[1], highest[1], dt, out)
        if radius > f32(0.0):
            forward, turning = speeds[0, t], speeds[2, t]
            for k in range(number):
                out[k] += max(radius - abs(forward[k]) / max(abs(turning[k]), f32(1e-6)), f32(0.0)) * dt
