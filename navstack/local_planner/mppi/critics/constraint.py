"""Penalizes velocities beyond the limits, and turns tighter than the turning radius."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from navstack.core.parameters import ParamModel, param
from navstack.local_planner.mppi._critic_kernels import constraint_scores
from navstack.local_planner.mppi.batch import Batch, Floats
from navstack.local_planner.mppi.trajectory_critic import TrajectoryCritic, TrajectoryCriticParams
from navstack.plugins import CRITICS


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
