"""The tuning problem: its objectives, its trials, and which of them are best."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from navstack.core import InputError
from navstack.parameters import Configuration, nearest
from navstack.studies.comparison import Case
from navstack.studies.evaluation import Evaluation, Outcome
from navstack.studies.search_space import SearchSpace, Value

# --- objectives -------------------------------------------------------------------------------------------------------


Outcomes = Sequence[Mapping[str, Any]]
"""Runs as given by `RunOutcome.as_dict`."""

FAILURE_FACTOR: Final = 3.0
"""In the mean time, a failed run counts this many times the slowest success."""
NO_SUCCESS: Final = 1e7
"""Mean time (s) and jerk (m/s³) of a candidate without any success: worse than any success."""


@dataclass(frozen=True, slots=True)
class Objective:
    """A number to maximize or minimize."""

    name: str
    maximize: bool
    of: Callable[[Outcomes], float]
    unit: str
    meaning: str

    @property
    def direction(self) -> str:
        """Optuna's name of the direction."""
        return "maximize" if self.maximize else "minimize"

    @property
    def label(self) -> str:
        """Name and unit."""
        return f"{self.name} ({self.unit})" if self.unit else self.name

    def better(self, a: float, b: float) -> bool:
        """Return True if `a` is better than `b`."""
        return a > b if self.maximize else a < b


def mean_score(outcomes: Outcomes) -> float:
    """Return the mean score of the runs."""
    return math.fsum(o["score"] for o in outcomes) / len(outcomes)


def success_rate(outcomes: Outcomes) -> float:
    """Return the share of successful runs."""
    return sum(bool(o["success"]) for o in outcomes) / len(outcomes)


def _successes(outcomes: Outcomes, key: str) -> list[float]:
    return [float(o[key]) for o in outcomes if o["success"]]


def mean_time(outcomes: Outcomes) -> float:
    """Return the mean time (s); a failure counts three times the slowest success. `NO_SUCCESS` without any success."""
    times = _successes(outcomes, "time_s")
    if not times:
        return NO_SUCCESS
    failed = len(outcomes) - len(times)
    return (math.fsum(times) + failed * FAILURE_FACTOR * max(times)) / len(outcomes)


def _mean_clearance(outcomes: Outcomes) -> float:
    return math.fsum(float(o["clearance_m"]) if o["success"] else 0.0 for o in outcomes) / len(outcomes)


def _mean_jerk(outcomes: Outcomes) -> float:
    values = _successes(outcomes, "jerk")
    return math.fsum(values) / len(values) if values else NO_SUCCESS


OBJECTIVES: Final[Mapping[str, Objective]] = {
    o.name: o
    for o in (
        Objective("score", True, mean_score, "", "score of the suite, with a penalty for failures"),
        Objective("time", False, mean_time, "s", "mean time, a failure counting three times the slowest success"),
        Objective("clearance", True, _mean_clearance, "m", "mean of the minimum clearance of each run"),
        Objective("smoothness", False, _mean_jerk, "m/s³", "root mean square of the jerk"),
        Objective("success", True, success_rate, "", "share of runs that reach every goal without a collision"),
    )
}


def select_objectives(names: Sequence[str]) -> tuple[Objective, ...]:
    """Return the objectives of these names; `score` without names. Raises InputError."""
    for name in names:
        if name not in OBJECTIVES:
            close = nearest(name, OBJECTIVES)
            hint = f"did you mean {close}?" if close else f"choose {', '.join(OBJECTIVES)}"
            raise InputError(
                f'--objective "{name}": unknown objective; {hint}',
                argument="--objective",
                value=name,
            )
    return tuple(OBJECTIVES[name] for name in dict.fromkeys(names or ["score"]))


def dominates(a: Sequence[float], b: Sequence[float], objectives: Sequence[Objective]) -> bool:
    """Return True if `a` is nowhere worse than `b` and somewhere better."""
    pairs = list(zip(a, b, objectives, strict=True))
    return not any(o.better(y, x) for x, y, o in pairs) and any(o.better(x, y) for x, y, o in pairs)


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
        """Return the objectives of a candidate's runs."""
        return [o.of(outcomes) for o in self.objectives]

    def succeeds_enough(self, outcomes: Sequence[Outcome]) -> bool:
        """Return True if the success rate is at least `min_success`."""
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
    """Return the complete trials with enough successes that no other such trial dominates."""
    good = [t for t in trials if t.complete and problem.succeeds_enough(list(t.outcomes.values()))]
    front = [t for t in good if not any(dominates(o.values, t.values, problem.objectives) for o in good)]
    unique: dict[tuple[float, ...], Trial] = {}
    for t in front:
        unique.setdefault(t.values, t)
    return sorted(unique.values(), key=lambda t: t.values)


def best_of(problem: Problem, trials: Sequence[Trial]) -> Trial | None:
    """Return the best trial; with several objectives, the trial of the front that is best by the first of them."""
    objective = problem.objectives[0]
    key: Callable[[Trial], float] = lambda t: t.values[0] if objective.maximize else -t.values[0]  # noqa: E731
    if len(problem.objectives) == 1:
        complete = [t for t in trials if t.complete]
        return max(complete, key=lambda t: (key(t), -t.number), default=None)
    return max(pareto_front(problem, trials), key=key, default=None)
