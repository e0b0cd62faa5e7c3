"""Prefers to drive forward, and straight on (PreferForwardCritic of Nav2's dwb_critics; move_base has none)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from navstack.core.parameters import ParamModel, param
from navstack.interfaces import Critic, Rollouts, ScoringContext
from navstack.plugins import CRITICS


class PreferForwardParams(ParamModel):
    """Weight, and what counts as not driving forward."""

    scale: float = param(1.0, "weight of this critic", ge=0.0)
    penalty: float = param(1.0, "cost of backing up, and of hardly moving", ge=0.0)
    strafe_x: float = param(0.1, "slower forward than this, and turning slowly, is hardly moving", unit="m/s", ge=0.0)
    strafe_theta: float = param(0.2, "turning slower than this is turning slowly", unit="rad/s", ge=0.0)
    theta_scale: float = param(10.0, "cost of each rad/s of turning, for what drives forward or turns in place", ge=0.0)


@CRITICS.register("prefer_forward", aliases=("dwb_critics/PreferForwardCritic", "PreferForward"))
class PreferForwardCritic(Critic):
    """`penalty` for backing up or hardly moving, else |wz| times `theta_scale`."""

    Params: ClassVar[type[ParamModel]] = PreferForwardParams

    @property
    def scale(self) -> float:
        """`scale`."""
        return self.params.scale

    def prepare(self, context: ScoringContext) -> None:
        """Nothing to prepare."""

    def score(self, rollouts: Rollouts, alive: NDArray[np.bool_]) -> NDArray[np.float64]:
        """(K,) of the velocities alone."""
        p = self.params
        vx, turn = rollouts.samples[:, 0], np.abs(rollouts.samples[:, 2])
        penalised = (vx < 0.0) | ((vx < p.strafe_x) & (turn < p.strafe_theta))
        return np.where(penalised, p.penalty, turn * p.theta_scale)
