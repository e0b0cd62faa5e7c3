"""Tables of a comparison: measures with confidence intervals, and a row per scenario."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

from navstack.bench.compare_bench import Pair
from navstack.bench.compare_scenarios import MEASURES, Measure
from navstack.bench.table import DIGITS, Column, Table
from navstack.statistics import Difference, Interval, mean, paired_difference, paired_share_difference, share

_MEASURE_COLUMNS: Final = (
    Column("measure", "measure"),
    Column("pairs", "pairs"),
    Column("a", "A", 3),
    Column("b", "B", 3),
    Column("difference", "B - A", 3),
    Column("verdict", "verdict"),
)
_SCENARIO_COLUMNS: Final = (
    Column("scenario", "scenario"),
    Column("pairs", "pairs"),
    Column("a_success", "A succeeds"),
    Column("b_success", "B succeeds"),
    Column("a_time_s", "A (s)", 1),
    Column("b_time_s", "B (s)", 1),
    Column("difference_s", "B - A (s)", 1),
)


def measures_table(pairs: Sequence[Pair]) -> Table:
    """A row per measure: both sides, the difference and the verdict.

    Scenarios are the independent groups; for a single scenario its seeds are, and the intervals hold for it alone. Identical
    runs count once: without noise, every seed repeats the same run.
    """
    pairs = distinct(pairs)
    single = len({p.scenario for p in pairs}) == 1
    rows = [_success_row(pairs, _groups(pairs, single))]
    for m in MEASURES:
        used = [p for p in pairs if (p.both_succeed or not m.both_succeed) and _has(p, m.key)]
        if used:
            rows.append(_measure_row(m, used, _groups(used, single)))
    over = "the seeds of one scenario" if single else "scenarios"
    return Table(f"B against A, with 95 % confidence intervals over {over}", _MEASURE_COLUMNS, rows)


def distinct(pairs: Sequence[Pair]) -> list[Pair]:
    """The pairs of runs without those that repeat a pair of the same scenario in every metric."""
    found: dict[tuple[str, str], Pair] = {}
    for pair in pairs:
        found.setdefault((pair.scenario, repr((sorted(pair.a.items()), sorted(pair.b.items())))), pair)
    return list(found.values())


def _groups(pairs: Sequence[Pair], single: bool) -> list[int] | list[str]:
    return [p.seed for p in pairs] if single else [p.scenario for p in pairs]


def _has(pair: Pair, key: str) -> bool:
    """True if both runs have a finite value."""
    values = (pair.a.get(key), pair.b.get(key))
    return all(isinstance(v, (int, float)) and math.isfinite(v) for v in values)


def _success_row(pairs: Sequence[Pair], groups: Sequence[int] | Sequence[str]) -> dict[str, Any]:
    a, b = [bool(p.a["success"]) for p in pairs], [bool(p.b["success"]) for p in pairs]
    difference = paired_share_difference(a, b, groups)
    return _row(Measure("success", "success", 3, +1), share(a, groups), share(b, groups), difference)


def _measure_row(m: Measure, pairs: Sequence[Pair], groups: Sequence[int] | Sequence[str]) -> dict[str, Any]:
    a, b = [float(p.a[m.key]) for p in pairs], [float(p.b[m.key]) for p in pairs]
    return _row(m, mean(a, groups), mean(b, groups), paired_difference(a, b, groups))


def _row(m: Measure, a: Interval, b: Interval, difference: Difference) -> dict[str, Any]:
    if not difference.shown:
        verdict = difference.verdict
    elif m.better == 0:
        verdict = f"B is {difference.verdict}"
    else:
        verdict = "B is better" if (difference.interval.value > 0.0) == (m.better > 0) else "A is better"
    return {
        "measure": m.name,
        "a": a,
        "b": b,
        "difference": difference,
        "pairs": difference.pairs,
        "verdict": verdict,
        DIGITS: m.digits,
    }


def scenarios_table(pairs: Sequence[Pair]) -> Table:
    """A row per scenario."""
    names = dict.fromkeys(p.scenario for p in pairs)
    rows = [_scenario_row(name, [p for p in pairs if p.scenario == name]) for name in names]
    return Table("scenarios (times of pairs in which both succeed)", _SCENARIO_COLUMNS, rows)


def _scenario_row(name: str, pairs: Sequence[Pair]) -> dict[str, Any]:
    both = [p for p in pairs if p.both_succeed]
    a = sum(p.a["time_s"] for p in both) / len(both) if both else None
    b = sum(p.b["time_s"] for p in both) / len(both) if both else None
    return {
        "scenario": name,
        "pairs": len(pairs),
        "a_success": sum(bool(p.a["success"]) for p in pairs),
        "b_success": sum(bool(p.b["success"]) for p in pairs),
        "a_time_s": a,
        "b_time_s": b,
        "difference_s": b - a if a is not None and b is not None else None,
    }
