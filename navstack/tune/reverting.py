"""Reverts the values of a candidate that make no difference, so that only the relevant changes remain."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Final

from navstack.jobs import Executor
from navstack.tune.problem import Problem
from navstack.tune.space import Value
from navstack.tune.work import Outcome, evaluate

TOLERANCE: Final = 0.001
"""Loss of the objective that a reverted value may cause: absolute for score and success, otherwise relative."""


def revert_unneeded(
    problem: Problem, executor: Executor, candidate: dict[str, Value], outcomes: Mapping[str, Outcome]
) -> tuple[dict[str, Value], Mapping[str, Outcome], tuple[str, ...]]:
    """Tries the present value of each dimension, in the order of the space, and keeps it if the objective gets no worse.

    Returns the remaining values, their outcomes, and the reverted dimensions.
    """
    cases = problem.cases
    objective = problem.objectives[0]

    def value(of: Mapping[str, Outcome]) -> float:
        return objective.of([of[c.key] for c in cases])

    reverted: list[str] = []
    initial = value(outcomes)
    best: float = initial
    tolerance: float = TOLERANCE if objective.name in ("score", "success") else abs(initial) * TOLERANCE
    for name in list(candidate):
        rest = {n: v for n, v in candidate.items() if n != name}
        if not rest:
            continue
        # relative to the best value so far, so that small losses do not add up
        allowed: float = best - tolerance if objective.maximize else best + tolerance
        tried = evaluate(
            executor,
            f"without {name}",
            tuple(problem.space.overrides(rest)),
            cases,
            hopeless=partial(_hopeless, problem, allowed),
        )
        if len(tried) < len(cases):
            continue
        reached: float = value(tried)
        if not objective.better(allowed, reached):
            candidate, outcomes = rest, tried
            reverted.append(name)
            best = max(best, reached) if objective.maximize else min(best, reached)
    return candidate, outcomes, tuple(reverted)


def _hopeless(problem: Problem, least: float, finished: Sequence[Outcome]) -> bool:
    """True if even the best scores in the remaining runs cannot raise the mean to `least`."""
    if problem.objectives[0].name != "score":
        return False
    remaining = (len(problem.cases) - len(finished)) * problem.evaluation.best_score
    return (sum(o["score"] for o in finished) + remaining) / len(problem.cases) < least
