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
        """Returns JSON data."""
        return {
            "value": self.value,
            "low": self.low,
            "high": self.high,
            "groups": self.groups,
            "level": self.level,
        }

    def text(self, digits: int = 2, unit: str = "") -> str:
        """Returns `0.85 [0.73, 0.92]`, or a dash without data."""
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

    @property
    def shown(self) -> bool:
        """True if the interval excludes zero."""
        return self.interval.low > 0.0 or self.interval.high < 0.0

    @property
    def verdict(self) -> str:
        """`higher`, `lower` or `no difference shown`: B compared with A."""
        if not self.shown:
            return "no difference shown"
        return "higher" if self.interval.value > 0.0 else "lower"

    def as_dict(self) -> dict[str, Any]:
        """Returns JSON data."""
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
        """Returns JSON data."""
        return {"rho": self.rho, "low": self.low, "high": self.high, "pairs": self.pairs, "level": self.level}


def share(successes: Sequence[bool], groups: Sequence[Hashable] | None = None, *, level: float = LEVEL) -> Interval:
    """Returns the share of successes with Wilson's interval (E. B. Wilson 1927), which stays within [0, 1].

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
    centre = (p + z2 / (2.0 * effective)) / (1.0 + z2 / effective)
    half = math.sqrt(z2 * (p * (1.0 - p) / effective + z2 / (4.0 * effective**2))) / (1.0 + z2 / effective)
    # rounding must not exclude the estimate from the interval
    return Interval(p, min(p, max(0.0, centre - half)), max(p, min(1.0, centre + half)), len(means), level)


def mean(values: Sequence[float], groups: Sequence[Hashable] | None = None, *, level: float = LEVEL) -> Interval:
    """Returns the mean with Student's interval over the groups' means; the bounds are NaN for a single group."""
    data = np.asarray(values, np.float64)
    if len(data) == 0:
        return _no_data(level)
    means, _ = _by_group(data, groups)
    return _student(means, level)


def paired_difference(
    a: Sequence[float], b: Sequence[float], groups: Sequence[Hashable] | None = None, *, level: float = LEVEL
) -> Difference:
    """Returns the mean of `b - a` with Student's interval over the groups' means; `a[i]`, `b[i]` are of one scenario and seed."""
    difference = _paired(a, b)
    if len(difference) == 0:
        return Difference(_no_data(level), 0, 0, 0)
    means, _ = _by_group(difference, groups)
    return _difference(_student(means, level), difference)


def paired_share_difference(
    a: Sequence[bool], b: Sequence[bool], groups: Sequence[Hashable] | None = None, *, level: float = LEVEL
) -> Difference:
    """Returns the difference of two shares over pairs, with the adjusted Wald interval of Bonett and Price (2012).

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
    """Returns Spearman's rho with Fisher's z interval, standard error 1.06 / sqrt(n - 3) (Fieller et al. 1957)."""
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


def _difference(interval: Interval, difference: NDArray[np.float64]) -> Difference:
    return Difference(interval, len(difference), int((difference > 0.0).sum()), int((difference < 0.0).sum()))


def _by_group(
    values: NDArray[np.float64], groups: Sequence[Hashable] | None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns mean and size of each group, in the order of their first values."""
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
