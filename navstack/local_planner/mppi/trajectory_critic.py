# pyright: basic
"""Base of the critics of MPPI: they score a whole batch, and never reject; collisions cost much."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from navstack.core import kernel
from navstack.local_planner.mppi.batch import Batch, Floats, TrajectoryContext
from navstack.plugins import Critic, ParamModel, Rollouts, ScoringContext, param

PERIOD_S = 0.05
"""Time between the points of rollouts of other planners, which have no time step of their own."""


class TrajectoryCriticParams(ParamModel):
    """What all critics of MPPI have."""

    enabled: bool = param(True, "use this critic")
    cost_power: int = param(1, "power of the weighted score", ge=1, le=9)
    cost_weight: float = param(1.0, "weight of the score", ge=0.0)


class TrajectoryCritic(Critic):
    """Scores the trajectories of MPPI: the total grows by (cost_weight * score) ** cost_power.

    With other planners, `score` gives the same for their rollouts, and rejects those that collide.
    """

    Params: ClassVar[type[ParamModel]] = TrajectoryCriticParams
    CODES: ClassVar[dict[int, str]] = {-1: "collides with an obstacle"}

    def __init__(self, name: str, params: Any) -> None:
        super().__init__(name, params)
        self._context: TrajectoryContext | None = None

    @property
    def scale(self) -> float:
        """1, since the weight is part of the score; 0 if the critic is off."""
        return 1.0 if self.params.enabled else 0.0

    @property
    def weight(self) -> float:
        """Factor on the raw score, before the power."""
        return self.params.cost_weight

    def prepare(self, context: ScoringContext) -> None:
        """Keep the context of this cycle."""
        self._context = TrajectoryContext.of(context)

    @property
    def context(self) -> TrajectoryContext:
        """The context of the last `prepare`."""
        assert self._context is not None, "prepare comes before score"
        return self._context

    @abstractmethod
    def score_batch(self, batch: Batch, out: Floats) -> bool:
        """Write raw scores (K,), weight and power not applied, to `out`; return False if the critic is not interested now."""

    def add_scores(self, batch: Batch, out: Floats, totals: Floats) -> bool:
        """Write the weighted scores (K,) to `out`, add them to `totals`; return False (and zeros) if it is not interested."""
        if not self.score_batch(batch, out):
            out[:] = 0.0
            return False
        add_powered(out, np.float32(self.weight), self.params.cost_power, totals)
        return True

    def score(self, rollouts: Rollouts) -> NDArray[np.float64]:
        """(K,) weighted scores of the rollouts of another planner; -1 for those that collide."""
        context = self.context
        anchor = context.state.pose.x, context.state.pose.y
        batch = Batch.of_rollouts(rollouts, anchor, PERIOD_S)
        context.begin(anchor)
        out, totals = np.zeros((2, batch.points.shape[2]), np.float32)
        self.add_scores(batch, out, totals)
        scores = out[: batch.number].astype(np.float64)
        scores[batch.collided[: batch.number]] = -1.0
        return scores


# --- kernels --------------------------------------------------------------------------------------------------------

f32 = np.float32
TWO_PI = f32(2.0 * math.pi)


@kernel
def add_powered(scores, weight, power, totals):
    """Turn raw `scores` (K,) into (weight * score) ** power, and add them to `totals` (K,)."""
    for k in range(len(scores)):
        scores[k] = scores[k] * weight
    if power > 1:
        for k in range(len(scores)):
            value = scores[k]
            for _ in range(power - 1):
                value *= scores[k]
            scores[k] = value
    for k in range(len(scores)):
        totals[k] += scores[k]


@kernel
def add_outside(row, low, high, weight, out):
    """Add `weight` times how far the values of `row` (K,) are outside of low .. high to `out` (K,)."""
    for k in range(len(row)):
        out[k] += (max(row[k] - high, f32(0.0)) + max(low - row[k], f32(0.0))) * weight


@kernel
def wrapped(angle):
    """Return the absolute value of an angle (rad) in (-pi, pi]."""
    return abs(angle - TWO_PI * np.floor(angle * f32(1.0 / (2.0 * math.pi)) + f32(0.5)))
