"""Scoring of rollouts: every critic in order, with a table of their scores."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from navstack.core.errors import InternalError
from navstack.interfaces import Critic, Rollouts, ScoringContext
from navstack.local_planner._scoring_kernels import add_scores, begin_table, lowest_total


@dataclass(frozen=True, slots=True, eq=False)
class ScoreTable:
    """Scores of K rollouts by C critics: see the fields of LocalPlan."""

    costs: NDArray[np.float64]
    scales: NDArray[np.float64]
    totals: NDArray[np.float64]
    rejected_by: NDArray[np.int8]
    best: int
    """Index of the lowest total (the first of equals); -1 if every rollout was rejected."""


def score(critics: Sequence[Critic], context: ScoringContext, rollouts: Rollouts) -> ScoreTable:
    """Prepare the critics and add up their weighted scores; the first negative score rejects a rollout.

    A critic with weight 0 is skipped. Raises InternalError for a critic that returns an array of the wrong shape or type.
    """
    k = len(rollouts.counts)
    alive = rollouts.alive
    costs = np.empty((k, len(critics)))
    scales = np.empty(len(critics))
    totals = np.empty(k)
    rejected_by = np.empty(k, np.int8)
    begin_table(rollouts.counts, alive, costs, totals, rejected_by)
    for i, critic in enumerate(critics):
        critic.prepare(context)
        scale = scales[i] = critic.scale
        if scale == 0.0:
            continue
        scores = critic.score(rollouts)
        if scores.shape != (k,) or scores.dtype != np.float64:
            raise InternalError(
                f'critic "{critic.name}" must return {k} float64 scores, not {scores.dtype} of shape {scores.shape}',
                critic=critic.name,
            )
        add_scores(scores, float(scale), i, alive, costs, totals, rejected_by)
    return ScoreTable(costs, scales, totals, rejected_by, lowest_total(totals, alive))
