"""Figures with the interval that they are known to within."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from orchestrator.evidence.bootstrap import CONFIDENCE, Band
from orchestrator.score.gather import Floats


@dataclass(frozen=True)
class Interval:
    """A figure and its two-sided confidence interval; NaN where undefined."""

    value: float
    low: float
    high: float

    def holds(self, value: float) -> bool:
        """Return whether a value is within the interval."""
        return self.low <= value <= self.high


def only(band: Band) -> Interval:
    """Return the interval of a statistic that has one point."""
    value, low, high = (float(part[0]) for part in (band.value, band.low, band.high))
    return Interval(value, low, high)


def share(
    count: int, of: int, confidence: float = CONFIDENCE, method: Literal["wilson", "exact"] = "wilson"
) -> Interval:
    """Return the share of ``count`` among ``of`` independent trials, and its interval.

    ``wilson`` is the score interval (Wilson 1927, JASA 22:209), close to its confidence on average; ``exact``
    that of Clopper and Pearson (1934, Biometrika 26:404), which never falls short of it. Without a trial all
    is NaN.
    """
    if not of:
        return Interval(math.nan, math.nan, math.nan)
    from scipy.stats import binomtest

    found = binomtest(count, of).proportion_ci(confidence, method)
    return Interval(count / of, float(found.low), float(found.high))


def mean_of_trials(values: Floats, confidence: float = CONFIDENCE) -> Interval:
    """Return the mean of independent values (N,) and Student's interval; NaN values are left out.

    The interval is NaN for fewer than two values.
    """
    from scipy.special import stdtrit

    kept = values[np.isfinite(values)]
    if kept.size < 2:
        return Interval(float(kept.mean()) if kept.size else math.nan, math.nan, math.nan)
    mean = float(kept.mean())
    with np.errstate(over="ignore"):  # the NEES of a filter that is lost knows no bounds
        spread = kept.std(ddof=1)
    reach = float(stdtrit(kept.size - 1, (1.0 + confidence) / 2.0) * spread / math.sqrt(kept.size))
    return Interval(mean, mean - reach, mean + reach)


def median_of_trials(values: Floats, confidence: float = CONFIDENCE) -> Interval:
    """Return the median of independent values (N,), N > 0, and its distribution-free interval.

    The interval lies between the order statistics ``k`` and ``N + 1 - k`` with the largest ``k`` whose
    coverage, that of a binomial of ``N`` fair draws, is at least ``confidence``; it is NaN where there are
    too few values for any. Values may be infinite.
    """
    from scipy.special import bdtr  # late: the import takes longer than the rest

    ordered = np.sort(values)
    size = ordered.size
    below = np.arange(size // 2)
    allowed = np.flatnonzero(2.0 * bdtr(below, size, 0.5) <= 1.0 - confidence)
    with np.errstate(invalid="ignore"):
        median = float(np.median(ordered))
    if not allowed.size:
        return Interval(median, math.nan, math.nan)
    k = int(allowed[-1])
    return Interval(median, float(ordered[k]), float(ordered[size - 1 - k]))
