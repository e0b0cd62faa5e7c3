"""The tuning problem, its trials, and which of them are best."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from navstack.parameters.configuration import Configuration
from navstack.tune.evaluation import Case, Evaluation
from navstack.tune.objectives import Objective, dominates, success_rate
from navstack.tune.space import SearchSpace, Value
from navstack.tune.work import Outcome

_TOLERANCE = 1e-9


@dataclass(frozen=True, slots=True)
class Problem:
    """Parameters to tune, cases to drive, objectives."""

    base: Configuration
    """The user's parameters."""
    space: SearchSpace
    evaluation: Evaluation
    """The training cases."""
    objectives: Sequence[Objective]
    min_success: float = 0.0
    """With several objectives: required success rate of a candidate."""

    @property
    def cases(self) -> tuple[Case, ...]:
        """The training cases."""
        return self.evaluation.cases

    def values(self, outcomes: Sequence[Outcome]) -> list[float]:
        """The objectives of a candidate's runs."""
        return [o.of(outcomes) for o in self.objectives]

    def succeeds_enough(self, outcomes: Sequence[Outcome]) -> bool:
        """True if the success rate is at least `min_success`."""
        return success_rate(outcomes) >= self.min_success - _TOLERANCE


@dataclass(frozen=True, slots=True)
class Trial:
    """A candidate and the outcomes of its runs."""

    number: int
    candidate: dict[str, Value]
    outcomes: dict[str, Outcome]
    """By the key of the case; a pruned trial has only some."""
    values: tuple[float, ...]
    """The objectives over these outcomes."""
    complete: bool
    """False for a pruned trial."""
    origin: str
    """present, start, or search."""


def pareto_front(problem: Problem, trials: Sequence[Trial]) -> list[Trial]:
    """The complete trials with enough successes that no other such trial dominates."""
    good = [t for t in trials if t.complete and problem.succeeds_enough(list(t.outcomes.values()))]
    front = [t for t in good if not any(dominates(o.values, t.values, problem.objectives) for o in good)]
    unique: dict[tuple[float, ...], Trial] = {}
    for t in front:
        unique.setdefault(t.values, t)
    return sorted(unique.values(), key=lambda t: t.values)


def best_of(problem: Problem, trials: Sequence[Trial]) -> Trial | None:
    """The best trial; with several objectives, the trial of the front that is best by the first of them."""
    objective = problem.objectives[0]
    key: Callable[[Trial], float] = lambda t: t.values[0] if objective.maximize else -t.values[0]  # noqa: E731
    if len(problem.objectives) == 1:
        complete = [t for t in trials if t.complete]
        return max(complete, key=lambda t: (key(t), -t.number), default=None)
    return max(pareto_front(problem, trials), key=key, default=None)
