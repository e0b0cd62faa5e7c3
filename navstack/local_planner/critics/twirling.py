"""Penalizes turning (base_local_planner/src/twirling_cost_function.cpp)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from navstack.plugins import CRITICS, Critic, ParamModel, Rollouts, param


class TwirlingParams(ParamModel):
    """Weight."""

    twirling_scale: float = param(0.0, "weight of the turning speed: prevents holonomic robots from spinning", ge=0.0)


@CRITICS.register("twirling", aliases=("base_local_planner/TwirlingCostFunction",))
class TwirlingCritic(Critic[TwirlingParams]):
    """|wz| of the command."""

    Params: ClassVar[type[ParamModel]] = TwirlingParams

    @property
    def scale(self) -> float:
        """`twirling_scale`."""
        return self.params.twirling_scale

    def score(self, rollouts: Rollouts) -> NDArray[np.float64]:
        """(K,) rad/s."""
        return np.abs(rollouts.commands[:, 2])
