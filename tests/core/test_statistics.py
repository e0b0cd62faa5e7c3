"""Intervals against published and simulated values; insufficient data is reported as such."""

from __future__ import annotations

import math
from typing import Any, cast

import numpy as np
import pytest
from scipy import stats

from navstack.core.errors import InternalError
from navstack.core.statistics import (
    mean,
    paired_difference,
    paired_share_difference,
    rank_correlation,
    rate,
    share,
    signed_rank_p,
)


@pytest.mark.parametrize(("k", "n"), [(0, 10), (10, 10), (36, 50), (81, 263), (15, 148)])
def test_a_share_has_the_wilson_interval(k: int, n: int) -> None:
    got = share([True] * k + [False] * (n - k))
    want = stats.binomtest(k, n).proportion_ci(method="wilson")
    assert (got.value, got.groups) == (k / n, n)
    assert (got.low, got.high) == (pytest.approx(want.low, abs=1e-12), pytest.approx(want.high, abs=1e-12))
    assert got.low <= got.value <= got.high


def test_copies_of_a_run_do_not_narrow_the_interval() -> None:
    once = [True, True, False, True, False, True, True, True]
    fivefold = share([s for s in once for _ in range(5)], [i for i in range(8) for _ in range(5)])
    assert fivefold.low == pytest.approx(share(once).low)
    assert fivefold.high == pytest.approx(share(once).high)
    assert share([True] * 50, [i // 5 for i in range(50)]).low == pytest.approx(share([True] * 10).low)


def test_variation_within_groups_increases_the_effective_sample_size() -> None:
    # every group the same mix: the runs are as good as independent
    mixed = share([True, False] * 20, [i // 4 for i in range(40)])
    assert mixed.high - mixed.low == pytest.approx((lambda i: i.high - i.low)(share([True, False] * 20)))


def test_a_mean_has_the_student_interval() -> None:
    values = [1.0, 2.5, 2.0, 4.0]
    got = mean(values)
    want = stats.ttest_1samp(values, 0.0).confidence_interval()
    assert (got.low, got.high) == (pytest.approx(want.low), pytest.approx(want.high))
    assert mean([v for v in values for _ in range(3)], [i for i in range(4) for _ in range(3)]) == got
    assert math.isnan(mean([3.0]).low) and mean([3.0]).value == 3.0
    assert mean([3.0]).text(1, " s") == "3.0 s" and mean([]).text() == "-"
    assert got.text(1) == "2.4 [0.4, 4.4]"


@pytest.mark.parametrize("rate", [0.1, 0.5, 0.9])
def test_intervals_have_their_nominal_coverage(rate: float) -> None:
    """In 400 experiments of 30 scenarios with 4 correlated seeds, the interval contains the true value in 95 % of the cases."""
    rng = np.random.default_rng(1)
    groups = [i for i in range(30) for _ in range(4)]
    inside = 0
    for _ in range(400):
        own = rng.beta(2.0 * rate, 2.0 * (1.0 - rate), 30)
        runs = rng.random((30, 4)) < own[:, None]
        interval = share(runs.ravel().tolist(), groups)
        inside += interval.low <= rate <= interval.high
    assert 0.92 <= inside / 400 <= 0.99


def test_paired_differences() -> None:
    a = [10.0, 12.0, 9.0, 20.0, 15.0, 11.0]
    better = paired_difference(a, [v - 1.0 + 0.1 * i for i, v in enumerate(a)])
    assert better.verdict == "lower" and (better.higher, better.lower, better.pairs) == (0, 6, 6)
    want = stats.ttest_rel([v - 1.0 + 0.1 * i for i, v in enumerate(a)], a).confidence_interval()
    assert better.interval.low <= want.low + 1e-12 and better.interval.high >= want.high - 1e-12
    assert paired_difference(a[:4], a[1:5]).interval.low == pytest.approx(
        stats.ttest_rel(a[1:5], a[:4]).confidence_interval().low
    )
    assert paired_difference(a[:5], [11.0, 11.0, 9.5, 18.0, 17.0]).verdict == "no difference shown"
    assert paired_difference(a, a).verdict == "no difference shown"
    assert paired_difference([], []).verdict == "no difference shown"
    assert paired_difference([1.0], [2.0]).verdict == "no difference shown"


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5])
def test_fewer_than_six_groups_show_no_difference(n: int) -> None:
    """Equal differences have an interval without width, but the signs agree by chance in 6 % of the cases or more."""
    assert paired_difference([0.0] * n, [1.0] * n).verdict == "no difference shown"
    assert paired_difference([0.0] * 6, [1.0] * 6).verdict == "higher"


@pytest.mark.parametrize("n", [3, 6, 9, 15])
def test_the_rank_test_is_wilcoxons(n: int) -> None:
    values = np.random.default_rng(n).normal(0.4, 1.0, n)
    signs = np.array(np.meshgrid(*[(-1, 1)] * n)).reshape(n, -1).T
    for tried in (values, np.round(2.0 * values) + 0.5):  # the second has ties
        ranks = stats.rankdata(np.abs(tried))
        sums = np.abs((signs * ranks).sum(axis=1))
        assert signed_rank_p(tried) == pytest.approx(float((sums >= abs((np.sign(tried) * ranks).sum())).mean()))
        assert signed_rank_p(np.append(tried, 0.0)) == signed_rank_p(tried)


def test_the_rank_test_of_many_values_is_close_to_the_exact_one() -> None:
    values = np.random.default_rng(3).normal(0.2, 1.0, 60)
    assert signed_rank_p(values) == pytest.approx(
        float(cast("Any", stats).wilcoxon(values, method="exact").pvalue), abs=0.01
    )


@pytest.mark.slow
@pytest.mark.parametrize(("n", "skewed", "symmetric"), [(5, 0.84, 0.92), (10, 0.87, 0.92), (20, 0.90, 0.92)])
def test_coverage_of_the_mean_of_skewed_times(n: int, skewed: float, symmetric: float) -> None:
    """Share of 400 experiments in which the interval contains the true mean; never below Student's."""
    rng = np.random.default_rng(n)
    for values, true, least in (
        (rng.exponential(1.0, (400, n)), 1.0, skewed),
        (rng.normal(0.0, 1.0, (400, n)), 0.0, symmetric),
    ):
        found = [mean(row.tolist()) for row in values]
        inside = sum(i.low <= true <= i.high for i in found)
        t = stats.ttest_1samp(values, 0.0, axis=1).confidence_interval()
        assert inside / 400 >= least
        assert inside >= int(((t.low <= true) & (true <= t.high)).sum())


@pytest.mark.slow
def test_equal_sides_seldom_differ() -> None:
    """Skewed times of two equal sides: a difference is shown in at most 6 % of 300 comparisons, at every size."""
    rng = np.random.default_rng(5)
    for n in (5, 6, 8, 12, 20):
        sides = rng.lognormal(3.0, 1.0, (300, 2, n)).tolist()
        assert sum(paired_difference(a, b).shown for a, b in sides) <= 0.06 * 300


def test_agreement_of_all_pairs_does_not_prove_equality() -> None:
    same = paired_share_difference([True] * 10, [True] * 10)
    assert same.verdict == "no difference shown"
    assert same.interval.value == 0.0 and same.interval.high == -same.interval.low > 0.2
    # Bonett and Price's interval by hand: 9 gains, 1 loss among 40
    a = [False] * 9 + [True] * 31
    b = [True] * 9 + [False] + [True] * 30
    got = paired_share_difference(a, b)
    up, down = 10 / 42, 2 / 42
    half = 1.959964 * math.sqrt((up + down - (up - down) ** 2) / 42)
    assert got.interval.low == pytest.approx(up - down - half, abs=1e-6)
    assert got.verdict == "higher" and (got.higher, got.lower) == (9, 1)


def test_copies_do_not_make_a_difference_significant() -> None:
    a, b = [False, False, True], [True, True, True]
    tenfold = paired_share_difference(
        [v for v in a for _ in range(10)], [v for v in b for _ in range(10)], [i for i in range(3) for _ in range(10)]
    )
    assert tenfold.interval == paired_share_difference(a, b).interval


def test_rank_correlation() -> None:
    a, b = [1.0, 2.0, 2.0, 4.0, 5.0, 0.5], [2.0, 1.0, 3.0, 5.0, 4.0, 0.0]
    got = rank_correlation(a, b)
    assert got.rho == pytest.approx(stats.spearmanr(a, b).statistic)
    assert got.low < got.rho < got.high and got.pairs == 6
    assert rank_correlation(a, a).rho == pytest.approx(1.0)
    assert math.isnan(rank_correlation(a, [1.0] * 6).rho)
    assert math.isnan(rank_correlation([1.0], [1.0]).rho)


def test_unpaired_values_are_rejected() -> None:
    for function in (paired_difference, paired_share_difference, rank_correlation):
        with pytest.raises(InternalError, match="pairs"):
            function([1.0], [1.0, 2.0])
    with pytest.raises(InternalError, match="groups"):
        mean([1.0, 2.0], ["a"])


def test_a_rate_has_the_exact_interval_of_a_poisson_process() -> None:
    """Without events, the upper bound is -ln(0.025) per exposure; events of one group widen the interval."""
    none = rate([0, 0, 0], [0.5, 0.25, 0.25])
    assert none.value == none.low == 0.0 and none.high == pytest.approx(-math.log(0.025))
    some = rate([3, 0, 2], [1.0, 0.5, 0.5])
    assert some.value == pytest.approx(2.5)
    assert (some.low, some.high) == (
        pytest.approx(0.5 * stats.chi2.ppf(0.025, 10) / 2.0),
        pytest.approx(0.5 * stats.chi2.ppf(0.975, 12) / 2.0),
    )
    even, clustered = rate([2] * 20, [1.0] * 20), rate([0] * 19 + [40], [1.0] * 20)
    assert even.value == clustered.value == 2.0 and clustered.high > even.high + 1.0
    assert math.isnan(rate([], []).value)
    with pytest.raises(InternalError, match="are not pairs"):
        rate([1], [])


def test_the_interval_of_a_rate_covers() -> None:
    rng = np.random.default_rng(4)
    covered = 0
    for _ in range(300):
        found = rate(rng.poisson(0.4, 16).tolist(), [0.1] * 16)
        covered += found.low <= 4.0 <= found.high
    assert covered >= 0.94 * 300
