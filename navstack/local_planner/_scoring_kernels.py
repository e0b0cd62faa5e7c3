# pyright: basic
"""Folding critics' scores into totals."""

from __future__ import annotations

import numpy as np

from navstack.core.jit import kernel


@kernel
def begin(counts, never, alive, costs, totals, rejected_by):
    """An empty table: nobody has said anything; what has no points is no trajectory (`never`)."""
    for k in range(len(counts)):
        alive[k] = counts[k] > 0
        totals[k] = 0.0 if alive[k] else np.nan
        rejected_by[k] = -1 if alive[k] else never
        for critic in range(costs.shape[1]):
            costs[k, critic] = np.nan


@kernel
def fold(raw, scale, critic, alive, costs, totals, rejected_by):
    """Takes one critic's raw scores in: adds to the totals of what is alive, rejects what is negative (or not a number).

    `costs` (K, C), `totals` (K,), `rejected_by` (K,) and `alive` (K,) are written. Returns how many are still alive.
    """
    left = 0
    for k in range(len(raw)):
        if not alive[k]:
            continue
        score = raw[k]
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
def lowest(totals, alive):
    """The first index of the lowest total that is alive, -1 without any."""
    best = -1
    for k in range(len(totals)):
        if alive[k] and (best < 0 or totals[k] < totals[best]):
            best = k
    return best
