"""Statistics of runs: confidence intervals of shares, means and paired differences, and rank correlation.

Runs of one world or scenario with several seeds are not independent: they form a group, and the sample size is the number of
groups. Without `groups`, each value is a group. Nothing is random.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core.errors import InternalError

LEVEL: Final = 0.95
_EXACT: Final = 50
_FEWEST_RESAMPLED: Final = 5
_RESAMPLES: Final = 1999
_SEED: Final = 20260101


@dataclass(frozen=True, slots=True)
class Interval:
    """An estimate and its confidence interval. All values are NaN without data."""

    value: float
    low: float
    high: float
    groups: int
    """Number of independent groups."""
    level: float = LEVEL

    def as_dict(self) -> dict[str, float | int]:
        """Return JSON data."""
        return {
            "value": self.value,
            "low": self.low,
            "high": self.high,
            "groups": self.groups,
            "level": self.level,
        }

    def text(self, digits: int = 2, unit: str = "") -> str:
        """Return `0.85 [0.73, 0.92]`, or a dash without data."""
        if math.isnan(self.value):
            return "-"
        head = f"{self.value:.{digits}f}{unit}"
        if math.isnan(self.low):
            return head
        return f"{head} [{self.low:.{digits}f}, {self.high:.{digits}f}]"


@dataclass(frozen=True, slots=True)
class Difference:
    """The difference B - A over pairs of runs with the same scenario and seed."""

    interval: Interval
    pairs: int
    higher: int
    """Number of pairs in which B is higher."""
    lower: int
    p_value: float = 0.0
    """Of Wilcoxon's signed-rank test of the groups; 0 for shares, which are not tested."""

    @property
    def excludes_zero(self) -> bool:
        """True if the interval excludes zero, for any number of groups."""
        return self.interval.low > 0.0 or self.interval.high < 0.0

    @property
    def shown(self) -> bool:
        """True if the interval excludes zero and the rank test is significant."""
        return self.excludes_zero and self.p_value <= 1.0 - self.interval.level + 1e-9

    @property
    def verdict(self) -> str:
        """`higher`, `lower` or `no difference shown`: B compared with A."""
        if not self.shown:
            return "no difference shown"
        return "higher" if self.interval.value > 0.0 else "lower"

    def as_dict(self) -> dict[str, Any]:
        """Return JSON data."""
        return {
            **self.interval.as_dict(),
            "pairs": self.pairs,
            "higher": self.higher,
            "lower": self.lower,
            "verdict": self.verdict,
        }


@dataclass(frozen=True, slots=True)
class Correlation:
    """Spearman's rank correlation; NaN for fewer than three pairs or if one side is constant."""

    rho: float
    low: float
    high: float
    pairs: int
    level: float = LEVEL

    def as_dict(self) -> dict[str, float | int]:
        """Return JSON data."""
        return {"rho": self.rho, "low": self.low, "high": self.high, "pairs": self.pairs, "level": self.level}


def share(successes: Sequence[bool], groups: Sequence[Hashable] | None = None, *, level: float = LEVEL) -> Interval:
    """Return the share of successes with Wilson's interval (E. B. Wilson 1927), which stays within [0, 1].

    With groups, the number of runs is replaced by the effective sample size (Korn and Graubard 1998): p (1 - p) divided by the
    variance of the groups' means, limited to between the number of groups and the number of runs.
    """
    values = np.asarray(successes, np.float64)
    if len(values) == 0:
        return _no_data(level)
    means, sizes = _by_group(values, groups)
    p = float(values.mean())
    effective = float(len(means))
    if 0.0 < p < 1.0 and 1 < len(means) < len(values):
        weights = sizes / sizes.sum()
        seen = len(means) / (len(means) - 1) * float((weights**2 * (means - p) ** 2).sum())
        effective = min(max(p * (1.0 - p) / seen, effective), float(len(values))) if seen > 0.0 else float(len(values))
    z2 = _normal_quantile(level) ** 2
    center = (p + z2 / (2.0 * effective)) / (1.0 + z2 / effective)
    half = math.sqrt(z2 * (p * (1.0 - p) / effective + z2 / (4.0 * effective**2))) / (1.0 + z2 / effective)
    # rounding must not exclude the estimate from the interval
    return Interval(p, min(p, max(0.0, center - half)), max(p, min(1.0, center + half)), len(means), level)


def mean(values: Sequence[float], groups: Sequence[Hashable] | None = None, *, level: float = LEVEL) -> Interval:
    """Return the mean with an interval over the groups' means (see the module); the bounds are NaN for a single group."""
    data = np.asarray(values, np.float64)
    if len(data) == 0:
        return _no_data(level)
    means, _ = _by_group(data, groups)
    return _mean_interval(means, level)


def rate(
    events: Sequence[int],
    exposures: Sequence[float],
    groups: Sequence[Hashable] | None = None,
    *,
    level: float = LEVEL,
) -> Interval:
    """Return events per unit of exposure (such as contacts per hour) with an interval; NaN without exposure.

    The interval covers the exact one of a Poisson process (F. Garwood 1936), which has a width even without events, and the
    bootstrap interval of the ratio over the groups (percentiles of 1999 resamples), since events of one group come together.
    """
    counts, times = np.asarray(events, np.float64), np.asarray(exposures, np.float64)
    if len(counts) != len(times):
        raise InternalError(f"{len(counts)} counts and {len(times)} exposures are not pairs")
    total = float(times.sum())
    if total <= 0.0:
        return _no_data(level)
    from scipy import special

    seen, tail = float(counts.sum()), 0.5 * (1.0 - level)
    low = float(special.gammaincinv(seen, tail)) / total if seen > 0.0 else 0.0
    high = float(special.gammaincinv(seen + 1.0, 1.0 - tail)) / total
    count_means, sizes = _by_group(counts, groups)
    time_means, _ = _by_group(times, groups)
    n = len(sizes)
    if seen > 0.0 and n >= _FEWEST_RESAMPLED:
        chosen = np.random.default_rng(_SEED).integers(0, n, (_RESAMPLES, n))
        exposure = (time_means * sizes)[chosen].sum(axis=1)
        ratios = (count_means * sizes)[chosen].sum(axis=1)[exposure > 0.0] / exposure[exposure > 0.0]
        low, high = min(low, float(np.quantile(ratios, tail))), max(high, float(np.quantile(ratios, 1.0 - tail)))
    return Interval(seen / total, low, high, n, level)


def paired_difference(
    a: Sequence[float], b: Sequence[float], groups: Sequence[Hashable] | None = None, *, level: float = LEVEL
) -> Difference:
    """Return the mean of `b - a` with an interval over the groups' means (see the module) and the p-value of a rank test.

    `a[i]` and `b[i]` are of one scenario and seed.
    """
    difference = _paired(a, b)
    if len(difference) == 0:
        return Difference(_no_data(level), 0, 0, 0)
    means, _ = _by_group(difference, groups)
    return _difference(_mean_interval(means, level), difference, signed_rank_p(means))


def paired_share_difference(
    a: Sequence[bool], b: Sequence[bool], groups: Sequence[Hashable] | None = None, *, level: float = LEVEL
) -> Difference:
    """Return the difference of two shares over pairs, with the adjusted Wald interval of Bonett and Price (2012).

    The interval has a positive width even if all pairs agree: ten scenarios that both pass do not prove two robots equal. With
    groups, the sample size is their number.
    """
    difference = _paired(a, b)
    if len(difference) == 0:
        return Difference(_no_data(level), 0, 0, 0)
    gains, _ = _by_group((difference > 0).astype(np.float64), groups)
    losses, _ = _by_group((difference < 0).astype(np.float64), groups)
    n = len(gains)
    up, down = (float(gains.sum()) + 1.0) / (n + 2.0), (float(losses.sum()) + 1.0) / (n + 2.0)
    half = _normal_quantile(level) * math.sqrt((up + down - (up - down) ** 2) / (n + 2.0))
    value = float(gains.mean() - losses.mean())
    low, high = max(-1.0, up - down - half), min(1.0, up - down + half)
    return _difference(Interval(value, min(low, value), max(high, value), n, level), difference)


def rank_correlation(a: Sequence[float], b: Sequence[float], *, level: float = LEVEL) -> Correlation:
    """Return Spearman's rho with Fisher's z interval, standard error 1.06 / sqrt(n - 3) (Fieller et al. 1957)."""
    x, y = np.asarray(a, np.float64), np.asarray(b, np.float64)
    if len(x) != len(y):
        raise InternalError(f"{len(x)} and {len(y)} values are not pairs")
    n = len(x)
    if n < 3 or np.ptp(x) == 0.0 or np.ptp(y) == 0.0:
        return Correlation(math.nan, math.nan, math.nan, n, level)
    from scipy import stats

    rho = float(np.corrcoef(stats.rankdata(x), stats.rankdata(y))[0, 1])
    if n == 3 or abs(rho) > 1.0 - 1e-12:
        return Correlation(rho, math.nan, math.nan, n, level)
    half = _normal_quantile(level) * 1.06 / math.sqrt(n - 3)
    return Correlation(rho, math.tanh(math.atanh(rho) - half), math.tanh(math.atanh(rho) + half), n, level)


def _no_data(level: float) -> Interval:
    return Interval(math.nan, math.nan, math.nan, 0, level)


def _paired(a: Sequence[float], b: Sequence[float]) -> NDArray[np.float64]:
    if len(a) != len(b):
        raise InternalError(f"{len(a)} and {len(b)} values are not pairs")
    return np.asarray(b, np.float64) - np.asarray(a, np.float64)


def _difference(interval: Interval, difference: NDArray[np.float64], p_value: float = 0.0) -> Difference:
    higher, lower = int((difference > 0.0).sum()), int((difference < 0.0).sum())
    return Difference(interval, len(difference), higher, lower, p_value)


def signed_rank_p(values: NDArray[np.float64]) -> float:
    """Return the two-sided p-value of Wilcoxon's signed-rank test of a median of 0; 1 without nonzero values.

    Zeros are left out and ties get their mean rank. Exact up to 50 values: the distribution of the sum of ranks over all
    assignments of signs. Beyond, the normal approximation with the tied variance.
    """
    nonzero = values[values != 0.0]
    if len(nonzero) == 0:
        return 1.0
    from scipy import special, stats

    ranks = np.rint(2.0 * stats.rankdata(np.abs(nonzero))).astype(np.int64)  # whole numbers also for ties
    total, positive = int(ranks.sum()), int(ranks[nonzero > 0.0].sum())
    smaller = min(positive, total - positive)
    if len(nonzero) > _EXACT:
        z = (smaller + 1 - total / 2.0) / math.sqrt(float((ranks.astype(np.float64) ** 2).sum()) / 4.0)
        return min(1.0, 2.0 * float(special.ndtr(min(z, 0.0))))
    counts = np.zeros(total + 1)
    counts[0] = 1.0
    for rank in ranks.tolist():
        counts[rank:] = counts[rank:] + counts[: total + 1 - rank]
    return min(1.0, 2.0 * float(counts[: smaller + 1].sum() / counts.sum()))


def _mean_interval(means: NDArray[np.float64], level: float) -> Interval:
    student = _student(means, level)
    n = len(means)
    if n < _FEWEST_RESAMPLED or np.ptp(means) == 0.0:
        return student
    low, high = _bca(means, level)
    return Interval(student.value, min(low, student.low), max(high, student.high), n, level)


def _bca(means: NDArray[np.float64], level: float) -> tuple[float, float]:
    """Return the BCa interval of the mean, with quantiles of Student's t instead of the normal ones (T. Hesterberg 2015)."""
    from scipy import special

    n, value = len(means), float(means.mean())
    rng = np.random.default_rng(_SEED)
    resampled = np.sort(means[rng.integers(0, n, (_RESAMPLES, n))].mean(axis=1))
    below = float((resampled < value).sum() + 0.5 * (resampled == value).sum()) / _RESAMPLES
    bias = float(special.ndtri(min(max(below, 1.0 / _RESAMPLES), 1.0 - 1.0 / _RESAMPLES)))
    apart = means - value
    skew = float((apart**3).sum() / (6.0 * (apart**2).sum() ** 1.5))
    t = float(special.stdtrit(n - 1, 0.5 + level / 2.0)) * math.sqrt(n / (n - 1))
    ends: list[float] = []
    for z in (-t, t):
        slope = 1.0 - skew * (bias + z)
        share_below = float(special.ndtr(bias + (bias + z) / slope)) if slope > 0.0 else float(z > 0.0)
        ends.append(float(np.quantile(resampled, share_below)))
    return ends[0], ends[1]


def _by_group(
    values: NDArray[np.float64], groups: Sequence[Hashable] | None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return mean and size of each group, in the order of their first values."""
    if groups is None:
        return values, np.ones(len(values))
    if len(groups) != len(values):
        raise InternalError(f"{len(values)} values have {len(groups)} groups; give the name of a group for each value")
    members: dict[Hashable, list[float]] = {}
    for group, value in zip(groups, values.tolist(), strict=True):
        members.setdefault(group, []).append(value)
    sizes = np.array([len(m) for m in members.values()], np.float64)
    return np.array([math.fsum(m) / len(m) for m in members.values()]), sizes


def _student(means: NDArray[np.float64], level: float) -> Interval:
    n = len(means)
    value = math.fsum(means.tolist()) / n
    if n == 1:
        return Interval(value, math.nan, math.nan, n, level)
    standard_error = float(np.std(means, ddof=1)) / math.sqrt(n)
    from scipy import special

    half = float(special.stdtrit(n - 1, 0.5 + level / 2.0)) * standard_error
    return Interval(value, value - half, value + half, n, level)


def _normal_quantile(level: float) -> float:
    from scipy import special

    return float(special.ndtri(0.5 + level / 2.0))
