"""Two parameter sets on the same cases: paired differences with confidence intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from navstack.statistics import Difference, Interval, mean, paired_difference, paired_share_difference, share
from navstack.tune.evaluation import Case

Outcome = Mapping[str, Any]

_PAIRED_MEASURES: Final = (
    ("time", "time_s", "s", False),
    ("clearance", "clearance_m", "m", True),
    ("jerk", "jerk", "m/s³", False),
    ("position error", "error_m", "m", False),
)
"""Measures of pairs in which both runs succeed: name, key of the outcome, unit, whether higher is better."""


@dataclass(frozen=True, slots=True)
class Measure:
    """A number of both sets and the difference, over pairs of runs of the same case."""

    name: str
    unit: str
    before: Interval
    after: Interval
    difference: Difference
    higher_is_better: bool

    @property
    def verdict(self) -> str:
        """better, worse, or `no difference shown`."""
        if not self.difference.shown:
            return "no difference shown"
        return "better" if (self.difference.interval.value > 0.0) is self.higher_is_better else "worse"

    @property
    def label(self) -> str:
        """Name and unit."""
        return f"{self.name} ({self.unit})" if self.unit else self.name

    @property
    def texts(self) -> tuple[str, str, str]:
        """Before, after and difference, rounded."""
        digits = 1 if self.unit == "s" else 3
        return self.before.text(digits), self.after.text(digits), self.difference.interval.text(digits)

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "unit": self.unit,
            "before": self.before.as_dict(),
            "after": self.after.as_dict(),
            "difference": self.difference.as_dict(),
            "verdict": self.verdict,
        }


@dataclass(frozen=True, slots=True)
class Comparison:
    """The outcomes of both sets, and the measures."""

    cases: tuple[Case, ...]
    before: tuple[Outcome, ...]
    after: tuple[Outcome, ...]
    measures: tuple[Measure, ...]
    """score, success, and those of pairs in which both runs succeed: time, clearance, jerk."""

    def measure(self, name: str) -> Measure:
        """The measure of that name. Raises KeyError if there is none."""
        found = self.find(name)
        if found is None:
            raise KeyError(name)
        return found

    def find(self, name: str) -> Measure | None:
        """The measure of that name, or None."""
        return next((m for m in self.measures if m.name == name), None)

    @property
    def fixed(self) -> list[int]:
        """Indices of cases that failed before and succeed after."""
        return [i for i, (b, a) in enumerate(zip(self.before, self.after)) if not b["success"] and a["success"]]

    @property
    def broken(self) -> list[int]:
        """Indices of cases that succeeded before and fail after."""
        return [i for i, (b, a) in enumerate(zip(self.before, self.after)) if b["success"] and not a["success"]]

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "cases": len(self.cases),
            "measures": {m.name: m.as_dict() for m in self.measures},
            "fixed": [self.cases[i].key for i in self.fixed],
            "broken": [self.cases[i].key for i in self.broken],
            "runs": [
                {"case": c.key, "before": dict(b), "after": dict(a)}
                for c, b, a in zip(self.cases, self.before, self.after)
            ],
        }


def compare(cases: Sequence[Case], before: Mapping[str, Outcome], after: Mapping[str, Outcome]) -> Comparison:
    """Compares outcomes by the key of the case. Runs of one scenario with several seeds form a group."""
    pairs = [(c.name, before[c.key], after[c.key]) for c in cases]
    measures = [_mean_measure("score", "", pairs, "score", True), _success(pairs)]
    both_succeed = [p for p in pairs if p[1]["success"] and p[2]["success"]]
    for name, key, unit, higher_is_better in _PAIRED_MEASURES:
        first, second = _values(both_succeed, key)
        if any(first) or any(second):
            measures.append(_mean_measure(name, unit, both_succeed, key, higher_is_better))
    return Comparison(tuple(cases), tuple(p[1] for p in pairs), tuple(p[2] for p in pairs), tuple(measures))


_Pairs = Sequence[tuple[str, Outcome, Outcome]]
"""Group, outcome before, outcome after."""


def _values(pairs: _Pairs, key: str) -> tuple[list[float], list[float]]:
    return [float(b.get(key, 0.0)) for _, b, _ in pairs], [float(a.get(key, 0.0)) for _, _, a in pairs]


def _mean_measure(name: str, unit: str, pairs: _Pairs, key: str, higher_is_better: bool) -> Measure:
    groups = [group for group, _, _ in pairs]
    first, second = _values(pairs, key)
    difference = paired_difference(first, second, groups)
    return Measure(name, unit, mean(first, groups), mean(second, groups), difference, higher_is_better)


def _success(pairs: _Pairs) -> Measure:
    groups = [group for group, _, _ in pairs]
    first, second = [bool(b["success"]) for _, b, _ in pairs], [bool(a["success"]) for _, _, a in pairs]
    difference = paired_share_difference(first, second, groups)
    return Measure("success", "", share(first, groups), share(second, groups), difference, True)
