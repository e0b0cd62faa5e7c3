"""Penalizes turning, which keeps holonomic robots from spinning on their way."""

from __future__ import annotations

from typing import ClassVar

from navstack.core.parameters import ParamModel, param
from navstack.local_planner.mppi._critic_kernels import turning_scores
from navstack.local_planner.mppi.batch import Batch, Floats
from navstack.local_planner.mppi.trajectory_critic import TrajectoryCritic, TrajectoryCriticParams
from navstack.plugins import CRITICS


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
