"""Comparisons of runs: the same cases with one thing and with another, paired, with confidence intervals."""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

from navstack.core import Difference, Interval, mean, paired_difference, paired_share_difference, share
from navstack.studies.table import DIGITS, Column, Table

Outcome = Mapping[str, Any]
"""Numbers of a run by name; `success` says whether it reached its goals."""


class Measure(NamedTuple):
    """A metric of a run that is compared."""

    key: str
    name: str
    digits: int
    better: int
    """+1: higher is better; -1: lower is better; 0: neither."""
    both_succeed: bool = True
    """Uses only the pairs in which both sides succeed: the time of a failure means nothing."""
    unit: str = ""
    """Shown behind the name."""
    possible: tuple[float, float] = (-math.inf, math.inf)
    """Range of its values: an interval does not leave it."""

    def clipped(self, interval: Interval) -> Interval:
        """Return the interval within the possible range."""
        low, high = self.possible
        return replace(interval, low=max(interval.low, low), high=min(interval.high, high))

    def clipped_difference(self, found: Difference) -> Difference:
        """Return the difference with an interval within the differences of two possible values."""
        width = self.possible[1] - self.possible[0]
        if math.isnan(found.interval.low):
            return found
        low, high = max(found.interval.low, -width), min(found.interval.high, width)
        return replace(found, interval=replace(found.interval, low=low, high=high))


@dataclass(frozen=True, slots=True)
class Case:
    """One scenario with one seed."""

    name: str
    """Name of the scenario; the runs of one scenario form a group."""
    seed: int

    @property
    def key(self) -> str:
        """Unique among all cases."""
        return f"{self.name} seed {self.seed}"


@dataclass(frozen=True, slots=True)
class Pair:
    """The runs of both sides in one scenario with one seed."""

    scenario: str
    seed: int
    a: Mapping[str, Any]
    b: Mapping[str, Any]

    @property
    def both_succeed(self) -> bool:
        """True if both runs succeeded."""
        return bool(self.a["success"] and self.b["success"])


@dataclass(frozen=True, slots=True)
class ComparedMeasure:
    """A measure of both sides, and the difference after - before over pairs of runs of the same case."""

    measure: Measure
    before: Interval
    after: Interval
    difference: Difference

    @property
    def name(self) -> str:
        """Name of the measure."""
        return self.measure.name

    @property
    def unit(self) -> str:
        """Unit of the measure; empty without one."""
        return self.measure.unit

    @property
    def label(self) -> str:
        """Name and unit."""
        return f"{self.name} ({self.unit})" if self.unit else self.name

    @property
    def texts(self) -> tuple[str, str, str]:
        """Before, after and difference, rounded."""
        digits = self.measure.digits
        return self.before.text(digits), self.after.text(digits), self.difference.interval.text(digits)

    @property
    def verdict(self) -> str:
        """better, worse, or `no difference shown`."""
        return self.verdict_in("better", "worse")

    def verdict_in(self, better: str, worse: str, neither: tuple[str, str] = ("higher", "lower")) -> str:
        """Return the verdict in these words; `neither`: for more and less of what is neither good nor bad."""
        if not self.difference.shown:
            return self.difference.verdict
        higher = self.difference.interval.value > 0.0
        if self.measure.better == 0:
            return neither[0] if higher else neither[1]
        return better if higher == (self.measure.better > 0) else worse

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "unit": self.unit,
            "before": self.before.as_dict(),
            "after": self.after.as_dict(),
            "difference": self.difference.as_dict(),
            "verdict": self.verdict,
        }


def compare(measure: Measure, pairs: Sequence[Pair], *, by_seed: bool = False) -> ComparedMeasure:
    """Compare one measure over the pairs of runs that have it.

    The runs of one scenario form a group (`by_seed`: those of one seed), whose mean counts once. `success` is compared as a
    share, everything else as a mean.
    """
    used = [p for p in pairs if (p.both_succeed or not measure.both_succeed) and _has(p, measure.key)]
    groups: list[Hashable] = [p.seed if by_seed else p.scenario for p in used]
    if measure.key == "success":
        a, b = [bool(p.a["success"]) for p in used], [bool(p.b["success"]) for p in used]
        return ComparedMeasure(measure, share(a, groups), share(b, groups), paired_share_difference(a, b, groups))
    a, b = [float(p.a[measure.key]) for p in used], [float(p.b[measure.key]) for p in used]
    difference = measure.clipped_difference(paired_difference(a, b, groups))
    return ComparedMeasure(measure, measure.clipped(mean(a, groups)), measure.clipped(mean(b, groups)), difference)


def _has(pair: Pair, key: str) -> bool:
    """Return True if both runs have a finite value."""
    values = (pair.a.get(key), pair.b.get(key))
    return all(isinstance(v, (int, float)) and math.isfinite(v) for v in values)


def distinct(pairs: Sequence[Pair]) -> list[Pair]:
    """Return the pairs of runs without those that repeat a pair of the same scenario in every metric."""
    found: dict[tuple[str, str], Pair] = {}
    for pair in pairs:
        found.setdefault((pair.scenario, repr((sorted(pair.a.items()), sorted(pair.b.items())))), pair)
    return list(found.values())


def comparison_table(title: str, compared: Sequence[ComparedMeasure], names: tuple[str, str] = ("A", "B")) -> Table:
    """Return a row per measure: pairs, both sides, their difference and the verdict."""
    a, b = names
    columns = (
        Column("measure", "measure"),
        Column("pairs", "pairs"),
        Column("a", a, 3),
        Column("b", b, 3),
        Column("difference", f"{b} - {a}", 3),
        Column("verdict", "verdict"),
    )
    rows = [
        {
            "measure": c.label,
            "a": c.before,
            "b": c.after,
            "difference": c.difference,
            "pairs": c.difference.pairs,
            "verdict": c.verdict_in(f"{b} is better", f"{a} is better", (f"{b} is higher", f"{b} is lower")),
            DIGITS: c.measure.digits,
        }
        for c in compared
    ]
    return Table(title, columns, rows)


# --- before and after -------------------------------------------------------------------------------------------------

_OUTCOME_MEASURES: Final = (
    Measure("score", "score", 3, +1, both_succeed=False, possible=(-1.0, 1.0)),
    Measure("success", "success", 3, +1, both_succeed=False),
    Measure("time_s", "time", 1, -1, unit="s", possible=(0.0, math.inf)),
    Measure("clearance_m", "clearance", 3, +1, unit="m", possible=(0.0, math.inf)),
    Measure("jerk", "jerk", 3, -1, unit="m/s³", possible=(0.0, math.inf)),
    Measure("error_m", "position error", 3, -1, unit="m", possible=(0.0, math.inf)),
)


@dataclass(frozen=True, slots=True)
class Comparison:
    """The outcomes of both sets, and the measures."""

    cases: tuple[Case, ...]
    before: tuple[Outcome, ...]
    after: tuple[Outcome, ...]
    measures: tuple[ComparedMeasure, ...]
    """score, success, and those of pairs in which both runs succeed: time, clearance, jerk."""

    def measure(self, name: str) -> ComparedMeasure:
        """Return the measure of that name. Raises KeyError if there is none."""
        found = self.find(name)
        if found is None:
            raise KeyError(name)
        return found

    def find(self, name: str) -> ComparedMeasure | None:
        """Return the measure of that name, or None."""
        return next((m for m in self.measures if m.name == name), None)

    @property
    def fixed(self) -> list[int]:
        """Indices of cases that failed before and succeed after."""
        return [i for i, (b, a) in enumerate(zip(self.before, self.after)) if not b["success"] and a["success"]]

    @property
    def broken(self) -> list[int]:
        """Indices of cases that succeeded before and fail after."""
        return [i for i, (b, a) in enumerate(zip(self.before, self.after)) if b["success"] and not a["success"]]

    @property
    def failed(self) -> list[int]:
        """Indices of cases that fail after."""
        return [i for i, a in enumerate(self.after) if not a["success"]]

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


def compare_outcomes(cases: Sequence[Case], before: Mapping[str, Outcome], after: Mapping[str, Outcome]) -> Comparison:
    """Compare the outcomes of candidates by the key of the case."""
    pairs = [Pair(c.name, c.seed, before[c.key], after[c.key]) for c in cases]
    # a measure that is 0 in all pairs, or not there, was not measured
    measured = [
        m
        for m in _OUTCOME_MEASURES
        if not m.both_succeed or any(p.a.get(m.key) or p.b.get(m.key) for p in pairs if p.both_succeed)
    ]
    return Comparison(
        tuple(cases), tuple(p.a for p in pairs), tuple(p.b for p in pairs), tuple(compare(m, pairs) for m in measured)
    )
