"""One cycle of scoring: every critic on every trajectory, in order, with a table of what each said."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from navstack.core.errors import InternalError
from navstack.interfaces import Critic, Rollouts, ScoringContext
from navstack.local_planner._scoring_kernels import begin, fold, lowest

NEVER = -2
"""`rejected_by` of a sample that is no trajectory: too slow on both counts, or too fast."""


@dataclass(frozen=True, slots=True, eq=False)
class ScoreTable:
    """K samples, C critics; the fields of LocalPlan."""

    costs: NDArray[np.float64]
    scales: NDArray[np.float64]
    totals: NDArray[np.float64]
    rejected_by: NDArray[np.int8]
    best: int
    """Index of the lowest total, the first of equals; -1 when every sample was rejected."""


def score(critics: Sequence[Critic], context: ScoringContext, rollouts: Rollouts) -> ScoreTable:
    """Prepares every critic and adds up its scores times its scale; the first negative score rejects.

    A critic with scale 0 is skipped. Raises InternalError when a critic breaks its contract.
    """
    k = len(rollouts.counts)
    alive = np.empty(k, np.bool_)
    costs = np.empty((k, len(critics)))
    scales = np.empty(len(critics))
    totals = np.empty(k)
    rejected_by = np.empty(k, np.int8)
    begin(rollouts.counts, NEVER, alive, costs, totals, rejected_by)
    for i, critic in enumerate(critics):
        critic.prepare(context)
        scale = scales[i] = critic.scale
        if scale == 0.0:
            continue
        raw = critic.score(rollouts, alive)
        if raw.shape != (k,) or raw.dtype != np.float64:
            raise InternalError(
                f'critic "{critic.name}" must return {k} float64 scores, not {raw.dtype} of shape {raw.shape}',
                critic=critic.name,
            )
        fold(raw, float(scale), i, alive, costs, totals, rejected_by)
    return ScoreTable(costs, scales, totals, rejected_by, lowest(totals, alive))
