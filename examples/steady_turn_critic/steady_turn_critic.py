"""A critic: prefers samples whose turning speed is close to that of the previous command."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from navstack.plugins import Critic, ParamModel, Pose2D, Rollouts, Twist2D, param


class SteadyTurnParams(ParamModel):
    """`<planner>/<name of the critic>:`."""

    scale: float = param(1.0, "weight of this critic in the sum", ge=0.0)


class SteadyTurnCritic(Critic[SteadyTurnParams]):
    """Scores the change of the turning speed (rad/s) since the previous command."""

    Params = SteadyTurnParams
    PLUGIN_ALIASES = ("steady_turn_critic/SteadyTurn",)
    previous = 0.0

    @property
    def scale(self) -> float:
        """Weight in the sum."""
        return self.params.scale

    def reset(self) -> None:
        """A new plan: reset the previous command."""
        self.previous = 0.0

    def score(self, rollouts: Rollouts) -> NDArray[np.float64]:
        """(K,) absolute change of the turning speed."""
        return np.abs(rollouts.commands[:, 2] - self.previous)

    def debrief(self, command: Twist2D, pose: Pose2D) -> None:
        """Remember the command that was selected."""
        self.previous = command.wz
