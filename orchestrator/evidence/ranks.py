"""Differences between two samples by their ranks: no law is assumed, and infinite errors have their place.

An estimator that diverged has an infinite error. Ranks order it behind every finite one, so that divergences
are neither dropped nor given a number; two that both diverged are a tie.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from orchestrator.evidence.bootstrap import CONFIDENCE
from orchestrator.evidence.intervals import Interval
from orchestrator.score.gather import Floats, Ints

PAIRED_EFFECT = "matched-pairs rank biserial"
UNPAIRED_EFFECT = "Cliff's delta"
_EXACT = 50
"""Pairs up to which the null distribution of the signed-rank statistic is computed exactly."""


@dataclass(frozen=True)
class Difference:
    """How sample A differs from sample B.

    Parameters
    ----------
    paired
        Whether the values were compared pair by pair.
    sizes
        Number of values of each that took part; equal when paired.
    shift
        Hodges-Lehmann estimate of A - B and its interval, that of the test's inversion; infinite ends are
        those that no finite number bounds.
    p_value
        Two-sided, of the Wilcoxon signed-rank test or, unpaired, the Mann-Whitney test.
    effect_name, effect
        The effect size, from -1 (A is always the smaller) to 1 (A is always the larger).
    least_p
        The smallest p value that samples of these sizes can give: above the level they are too few.
    identical
        Whether no pair differs.
    """

    paired: bool
    sizes: tuple[int, int]
    shift: Interval
    p_value: float
    effect_name: str
    effect: float
    least_p: float
    identical: bool


_UNKNOWN = Interval(np.nan, np.nan, np.nan)


def paired_difference(a: Floats, b: Floats, confidence: float = CONFIDENCE) -> Difference:
    """Return how paired values (N,) differ: Wilcoxon's signed-rank test (1945, Biometrics Bulletin 1:80).

    Zero differences keep their ranks (Pratt 1959, JASA 54:655). The estimate is the median of the Walsh
    averages, its interval that of Hodges and Lehmann (1963, Ann. Math. Stat. 34:598), the effect size the
    matched-pairs rank biserial correlation (Kerby 2014). Neither may hold NaN.
    """
    from scipy.stats import rankdata, wilcoxon

    with np.errstate(invalid="ignore"):
        differences = np.where(a == b, 0.0, a - b)
    n = differences.size
    least = least_p(True, n, n)
    identical = not differences.any()
    if not n or identical:
        shift = Interval(0.0, 0.0, 0.0) if n else _UNKNOWN
        return Difference(True, (n, n), shift, 1.0, PAIRED_EFFECT, 0.0, least, n > 0)
    p_value = float(wilcoxon(differences, zero_method="pratt").pvalue)
    moved = differences[differences != 0.0]
    ranks = rankdata(np.abs(moved))
    effect = float(np.sum(np.sign(moved) * ranks) / np.sum(ranks))
    values, largest = _finite(differences)
    first, second = np.triu_indices(n)
    averages = np.sort(0.5 * (values[first] + values[second]))
    shift = _inverted(averages, _signed_rank_cut(n, (1.0 - confidence) / 2.0), largest)
    return Difference(True, (n, n), shift, p_value, PAIRED_EFFECT, effect, least, False)


def unpaired_difference(a: Floats, b: Floats, confidence: float = CONFIDENCE) -> Difference:
    """Return how independent values (N,) and (M,) differ: the test of Mann and Whitney (1947).

    The estimate is the median of all differences with the interval of Hodges and Lehmann, the effect size
    Cliff's delta (1993, Psychological Bulletin 114:494). Neither may hold NaN.
    """
    from scipy.stats import mannwhitneyu

    n, m = a.size, b.size
    if not n or not m:
        return Difference(False, (n, m), _UNKNOWN, 1.0, UNPAIRED_EFFECT, 0.0, 1.0, False)
    joined, largest = _finite(np.concatenate([a, b]))
    apart = np.sort((joined[:n, None] - joined[None, n:]).ravel())
    effect = float(np.mean(np.sign(apart)))
    p_value = float(mannwhitneyu(joined[:n], joined[n:]).pvalue) if np.ptp(joined) else 1.0
    cut = _normal_cut(n * m / 2.0, n * m * (n + m + 1) / 12.0, (1.0 - confidence) / 2.0)
    shift = _inverted(apart, cut, largest)
    least = least_p(False, n, m)
    return Difference(False, (n, m), shift, p_value, UNPAIRED_EFFECT, effect, least, False)


def least_p(paired: bool, first: int, second: int) -> float:
    """Return the smallest p value that samples of these sizes can give."""
    if paired:
        return float(min(1.0, 2.0 ** (1 - first)))
    return min(1.0, 2.0 / math.comb(first + second, first))


def _finite(values: Floats) -> tuple[Floats, float]:
    """Return values with infinities made finite, far beyond all others, and how large they became."""
    known = np.abs(values[np.isfinite(values)])
    largest = 1e12 * max(float(known.max(initial=0.0)), 1e-100)
    return np.clip(values, -largest, largest), largest


def _inverted(ordered: Floats, cut: int, largest: float) -> Interval:
    """Return the median of ordered figures, and the interval that leaves ``cut`` - 1 out at each end."""
    low, high = (ordered[cut - 1], ordered[-cut]) if cut > 0 else (-np.inf, np.inf)
    figures = (float(np.median(ordered)), float(low), float(high))
    return Interval(*(math.copysign(math.inf, x) if abs(x) > largest / 4.0 else x for x in figures))


def _signed_rank_cut(n: int, tail: float) -> int:
    """Return the largest k with ``P(T < k) <= tail`` of the signed-rank statistic T of n pairs."""
    if n > _EXACT:
        return _normal_cut(n * (n + 1) / 4.0, n * (n + 1) * (2 * n + 1) / 24.0, tail)
    ways = np.zeros(n * (n + 1) // 2 + 1)
    ways[0] = 1.0
    for rank in range(1, n + 1):
        ways[rank:] = ways[rank:] + ways[:-rank]
    return int(np.searchsorted(np.cumsum(ways) / 2.0**n, tail, side="right"))


def _normal_cut(mean: float, variance: float, tail: float) -> int:
    from scipy.special import ndtri

    return max(0, round(mean + float(ndtri(tail)) * math.sqrt(variance)))


def holm(p_values: Sequence[float]) -> list[float]:
    """Return p values adjusted so that all together err with the level of one (Holm 1979)."""
    order = np.argsort(p_values, kind="stable")
    scaled = [min(1.0, (len(order) - rank) * p_values[at]) for rank, at in enumerate(order)]
    adjusted = np.empty(len(order))
    adjusted[order] = np.maximum.accumulate(scaled) if scaled else []
    return [float(p) for p in adjusted]


def pair(keys_a: Sequence[tuple[int, int]], keys_b: Sequence[tuple[int, int]]) -> tuple[Ints, Ints]:
    """Return the places in A and in B of the trials, by (seed, trial), that both have."""
    at = {key: i for i, key in enumerate(keys_b)}
    both = [(i, at[key]) for i, key in enumerate(keys_a) if key in at]
    places = np.array(both, dtype=np.int64).reshape(-1, 2)
    return places[:, 0], places[:, 1]
