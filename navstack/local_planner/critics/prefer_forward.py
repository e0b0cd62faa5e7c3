"""Prefers to drive straight forward (PreferForwardCritic of Nav2's dwb_critics; not part of move_base)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from navstack.plugins import CRITICS, Critic, ParamModel, Rollouts, param


class PreferForwardParams(ParamModel):
    """Weight, and the thresholds below which a rollout does not drive forward."""

    scale: float = param(1.0, "weight of this critic", ge=0.0)
    penalty: float = param(1.0, "cost of driving backward, and of almost standing still", ge=0.0)
    strafe_x: float = param(
        0.1, "forward speed below which a slowly turning robot counts as almost standing still", unit="m/s", ge=0.0
    )
    strafe_theta: float = param(
        0.2, "turning speed below which the robot counts as turning slowly", unit="rad/s", ge=0.0
    )
    theta_scale: float = param(10.0, "cost per rad/s of turning, while driving forward or turning in place", ge=0.0)


@CRITICS.register("prefer_forward", aliases=("dwb_critics/PreferForwardCritic", "PreferForward"))
class PreferForwardCritic(Critic[PreferForwardParams]):
    """`penalty` for driving backward or almost standing still, else |wz| times `theta_scale`."""

    Params: ClassVar[type[ParamModel]] = PreferForwardParams

    @property
    def scale(self) -> float:
        """`scale`."""
        return self.params.scale

    def score(self, rollouts: Rollouts) -> NDArray[np.float64]:
        """(K,) from the commands alone."""
        p = self.params
        vx, turn = rollouts.commands[:, 0], np.abs(rollouts.commands[:, 2])
        penalized = (vx < 0.0) | ((vx < p.strafe_x) & (turn < p.strafe_theta))
        return np.where(penalized, p.penalty, turn * p.theta_scale)
