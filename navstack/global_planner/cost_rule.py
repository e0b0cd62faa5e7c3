"""What entering a cell costs, by its byte: the one place where planners differ in what they may cross."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from navstack.core import INSCRIBED, LETHAL, UNKNOWN

NAVFN_NEUTRAL = 50
_INVSQRT2 = 0.707106781  # navfn.h
_HIGHEST_STEP = 253  # navfn.h, COST_OBS - 1
_LEAST_STEP = 0.004
"""A quadratic potential exceeds the higher of the two neighbours it is entered over by 0.0046 of the cost, at least."""


@dataclass(frozen=True, slots=True, eq=False)
class CostRule:
    """`steps` (256,) float32: the potential it takes to enter a cell of that byte; `weights`: over sqrt 2, inf = blocked."""

    steps: NDArray[np.float32]
    weights: NDArray[np.float32]
    blocked: NDArray[np.bool_]
    neutral: float
    """What a free cell costs."""
    quadratic: bool
    allow_unknown: bool

    def describe(self, cost: int) -> str:
        """Why a cell of that byte is blocked, for messages."""
        return "unknown, and allow_unknown is false" if cost == UNKNOWN and not self.allow_unknown else "an obstacle"


def rule_of(
    steps: NDArray[np.float32], blocked: NDArray[np.bool_], neutral: float, quadratic: bool, allow_unknown: bool
) -> CostRule:
    """The rule with these `steps` (256,) float32 and these bytes `blocked` (256,)."""
    weights = (_INVSQRT2 * steps.astype(np.float64)).astype(np.float32)
    weights[blocked] = np.inf
    for array in (steps, weights, blocked):
        array.setflags(write=False)
    return CostRule(steps, weights, blocked, neutral, quadratic, allow_unknown)


@cache
def careful(rule: CostRule) -> CostRule:
    """The rule of a wave that looks again at every neighbour that could come lower still.

    navfn's quadratic potential is entered over two neighbours, but a cell is queued only when the one that was lowered would
    make it lower by itself: what the other adds is left out, and how much that is depends on the order in which cells come. With
    this rule it does not: no wave comes lower.
    """
    if not rule.quadratic:
        return rule
    weights = (_LEAST_STEP * rule.steps).astype(np.float32)
    weights[rule.blocked] = np.inf
    weights.setflags(write=False)
    return replace(rule, weights=weights)


@cache
def navfn_rule(allow_unknown: bool) -> CostRule:
    """navfn: 50 + 0.8 * cost, at most 253; 253 and 254 blocked; unknown 253 or blocked (algorithms.md 3)."""
    bytes_ = np.arange(256)
    steps = np.minimum(NAVFN_NEUTRAL + (0.8 * bytes_).astype(np.int64), _HIGHEST_STEP).astype(np.float32)
    blocked = (bytes_ == INSCRIBED) | (bytes_ == LETHAL)
    blocked[UNKNOWN] = not allow_unknown
    return rule_of(steps, blocked, float(NAVFN_NEUTRAL), True, allow_unknown)


@cache
def global_planner_rule(
    lethal_cost: int, neutral_cost: int, cost_factor: float, allow_unknown: bool, quadratic: bool
) -> CostRule:
    """global_planner: cost * cost_factor + neutral_cost, at most lethal_cost - 1; blocked from lethal_cost - 1 up."""
    bytes_ = np.arange(256)
    free = bytes_ < lethal_cost - 1
    free[UNKNOWN] = allow_unknown
    factor = np.float32(cost_factor)
    steps = bytes_.astype(np.float32) * factor + np.float32(neutral_cost)
    steps = np.where(steps >= lethal_cost, np.float32(max(1, lethal_cost - 1)), steps).astype(np.float32)
    return rule_of(steps, ~free, float(neutral_cost), quadratic, allow_unknown)
