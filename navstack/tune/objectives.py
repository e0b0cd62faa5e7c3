"""What is wanted of a candidate, from how its runs ended."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from navstack.core.errors import InputError
from navstack.parameters.spelling import nearest

Outcomes = Sequence[Mapping[str, Any]]
"""Runs as `RunOutcome.as_dict` tells them."""

FAILED_TIMES: Final = 3.0
"""A run that failed counts in the mean time as so many times the slowest that succeeded."""
NOTHING: Final = 1e7
"""Mean time (s) and jerk (m/s³) where no run succeeded: worse than whatever did."""


@dataclass(frozen=True, slots=True)
class Objective:
    """A number to make as high or as low as possible."""

    name: str
    maximize: bool
    of: Callable[[Outcomes], float]
    unit: str
    meaning: str

    @property
    def direction(self) -> str:
        """As Optuna says it."""
        return "maximize" if self.maximize else "minimize"

    def better(self, a: float, b: float) -> bool:
        """True when `a` is better than `b`."""
        return a > b if self.maximize else a < b


def mean_score(outcomes: Outcomes) -> float:
    """Mean of the runs' scores."""
    return math.fsum(o["score"] for o in outcomes) / len(outcomes)


def success_rate(outcomes: Outcomes) -> float:
    """Share of the runs that succeeded."""
    return sum(bool(o["success"]) for o in outcomes) / len(outcomes)


def _successes(outcomes: Outcomes, key: str) -> list[float]:
    return [float(o[key]) for o in outcomes if o["success"]]


def mean_time(outcomes: Outcomes) -> float:
    """Mean time (s); a failure counts three times the slowest success. `NOTHING` where no run succeeded."""
    times = _successes(outcomes, "time_s")
    if not times:
        return NOTHING
    failed = len(outcomes) - len(times)
    return (math.fsum(times) + failed * FAILED_TIMES * max(times)) / len(outcomes)


def _mean_clearance(outcomes: Outcomes) -> float:
    return math.fsum(float(o["clearance_m"]) if o["success"] else 0.0 for o in outcomes) / len(outcomes)


def _mean_jerk(outcomes: Outcomes) -> float:
    values = _successes(outcomes, "jerk")
    return math.fsum(values) / len(values) if values else NOTHING


OBJECTIVES: Final[Mapping[str, Objective]] = {
    o.name: o
    for o in (
        Objective("score", True, mean_score, "", "the course's own score, a failure counting against it"),
        Objective("time", False, mean_time, "s", "mean time, a failure counting three times the slowest success"),
        Objective("clearance", True, _mean_clearance, "m", "mean of the runs' least distance to anything"),
        Objective("smoothness", False, _mean_jerk, "m/s³", "root mean square of the jerk"),
        Objective("success", True, success_rate, "", "share of runs at every goal without contact"),
    )
}


def chosen(names: Sequence[str]) -> tuple[Objective, ...]:
    """The objectives of these names; `score` alone for none. Raises InputError."""
    for name in names:
        if name not in OBJECTIVES:
            close = nearest(name, OBJECTIVES)
            hint = f"did you mean {close}?" if close else f"choose {', '.join(OBJECTIVES)}"
            raise InputError(
                f'--objective "{name}": there is no such objective; {hint}',
                argument="--objective",
                value=name,
            )
    return tuple(OBJECTIVES[name] for name in dict.fromkeys(names or ["score"]))


def dominates(a: Sequence[float], b: Sequence[float], objectives: Sequence[Objective]) -> bool:
    """True when `a` is nowhere worse than `b` and somewhere better."""
    pairs = list(zip(a, b, objectives, strict=True))
    return not any(o.better(y, x) for x, y, o in pairs) and any(o.better(x, y) for x, y, o in pairs)
