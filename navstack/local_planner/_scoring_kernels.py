# pyright: basic
"""Adding critics' scores to the totals of rollouts."""

from __future__ import annotations

import numpy as np

from navstack.core.jit import kernel

OUTSIDE_LIMITS = -2
"""`rejected_by` of a velocity sample without a trajectory: below the lowest or above the highest speed."""


@kernel
def begin_table(counts, alive, costs, totals, rejected_by):
    """Initialize the table: rollouts without points are OUTSIDE_LIMITS, all others are alive."""
    for k in range(len(counts)):
        alive[k] = counts[k] > 0
        totals[k] = 0.0 if alive[k] else np.nan
        rejected_by[k] = -1 if alive[k] else OUTSIDE_LIMITS
        for critic in range(costs.shape[1]):
            costs[k, critic] = np.nan


@kernel
def add_scores(scores, scale, critic, alive, costs, totals, rejected_by):
    """Add one critic's scores to the totals of the rollouts that are alive; a negative score (or NaN) rejects.

    Writes `costs` (K, C), `totals`, `rejected_by` and `alive` (K,). Returns how many are still alive.
    """
    left = 0
    for k in range(len(scores)):
        if not alive[k]:
            continue
        score = scores[k]
        costs[k, critic] = score
        if score >= 0.0:
            totals[k] += score * scale
            left += 1
        else:
            totals[k] = score
            rejected_by[k] = critic
            alive[k] = False
    return left


@kernel
def lowest_total(totals, alive):
    """Index of the lowest total among the rollouts that are alive (the first of equals); -1 if none is."""
    best = -1
    for k in range(len(totals)):
        if alive[k] and (best < 0 or totals[k] < totals[best]):
            best = k
    return best
