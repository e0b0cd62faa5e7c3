"""Comparisons: repeated runs count once, and better is said only where it is shown."""

from __future__ import annotations

from typing import Any

import pytest

from navstack.core import Interval
from navstack.studies.comparison import Pair, distinct
from navstack.studies.parameter_sets import MEASURES, measures_table


def run(time_s: float, ended: str = "") -> dict[str, Any]:
    return {"success": True, "ended": ended, "time_s": time_s}


def verdict(pairs: list[Pair]) -> str:
    return next(r["verdict"] for r in measures_table(pairs).rows if "time" in r["measure"])


@pytest.mark.parametrize("seeds", [1, 2, 10, 100])
def test_identical_seeds_count_once(seeds: int) -> None:
    pairs = [Pair("office", seed, run(20.0), run(19.0)) for seed in range(seeds)]
    assert len(distinct(pairs)) == 1
    assert verdict(pairs) == "no difference shown"
    assert [r["pairs"] for r in measures_table(pairs).rows] == [1, 1]


def test_different_runs_all_count() -> None:
    pairs = [Pair("office", seed, run(20.0 + 0.1 * seed), run(19.0)) for seed in range(8)]
    assert len(distinct(pairs)) == 8
    assert verdict(pairs) == "B is better"
    assert verdict(pairs[:5]) == "no difference shown"
    assert len(distinct([*pairs, Pair("maze", 0, run(20.0), run(19.0))])) == 9


def test_no_interval_is_cut_off_below_its_value() -> None:
    """People who overlap the robot have a negative distance."""
    distance = next(measure for measure in MEASURES if measure.key == "distance_min_m")
    overlap = Interval(-0.438, -0.577, -0.271, 6)
    assert distance.clipped(overlap) == overlap
    share = next(measure for measure in MEASURES if measure.key == "discomfort")
    assert share.clipped(Interval(0.2, -0.1, 1.2, 6)) == Interval(0.2, 0.0, 1.0, 6)
