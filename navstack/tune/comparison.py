"""Two parameter sets over the same cases: paired differences with confidence intervals, in numbers and in a sentence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from navstack.statistics import Difference, Interval, mean, paired_difference, paired_share_difference, share
from navstack.tune.courses import Case

Outcome = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Measure:
    """One number of both sets and the difference, over pairs of runs of the same case."""

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
    """Before and after over some cases."""

    cases: tuple[Case, ...]
    before: tuple[Outcome, ...]
    after: tuple[Outcome, ...]
    measures: tuple[Measure, ...]
    """score, success, time (of pairs that both succeed), clearance."""

    def measure(self, name: str) -> Measure:
        """The measure of that name."""
        return next(m for m in self.measures if m.name == name)

    @property
    def mended(self) -> list[int]:
        """Cases that failed before and succeed after, by index."""
        return [i for i, (b, a) in enumerate(zip(self.before, self.after)) if not b["success"] and a["success"]]

    @property
    def broken(self) -> list[int]:
        """Cases that succeeded before and fail after."""
        return [i for i, (b, a) in enumerate(zip(self.before, self.after)) if b["success"] and not a["success"]]

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "cases": len(self.cases),
            "measures": {m.name: m.as_dict() for m in self.measures},
            "mended": [self.cases[i].key for i in self.mended],
            "broken": [self.cases[i].key for i in self.broken],
            "runs": [
                {"case": c.key, "before": dict(b), "after": dict(a)}
                for c, b, a in zip(self.cases, self.before, self.after)
            ],
        }


def compare(cases: Sequence[Case], before: Mapping[str, Outcome], after: Mapping[str, Outcome]) -> Comparison:
    """Compares outcomes by the case's key. Runs of one scenario under several seeds are one group."""
    b, a = [before[c.key] for c in cases], [after[c.key] for c in cases]
    groups = [c.name for c in cases]
    measures = [
        Measure(
            "score",
            "",
            mean([o["score"] for o in b], groups),
            mean([o["score"] for o in a], groups),
            paired_difference([o["score"] for o in b], [o["score"] for o in a], groups),
            True,
        ),
        Measure(
            "success",
            "",
            share([bool(o["success"]) for o in b], groups),
            share([bool(o["success"]) for o in a], groups),
            paired_share_difference([bool(o["success"]) for o in b], [bool(o["success"]) for o in a], groups),
            True,
        ),
    ]
    both = [i for i in range(len(b)) if b[i]["success"] and a[i]["success"]]
    paired_groups = [groups[i] for i in both]
    for name, key, unit, higher in (
        ("time", "time_s", "s", False),
        ("clearance", "clearance_m", "m", True),
        ("jerk", "jerk", "m/s³", False),
    ):
        first, second = [float(b[i][key]) for i in both], [float(a[i][key]) for i in both]
        if not any(first) and not any(second):
            continue
        measures.append(
            Measure(
                name,
                unit,
                mean(first, paired_groups),
                mean(second, paired_groups),
                paired_difference(first, second, paired_groups),
                higher,
            )
        )
    return Comparison(tuple(cases), tuple(b), tuple(a), tuple(measures))
