"""Differences between two samples by their ranks: no law is assumed, and infinite errors have their place.

An estimator that diverged has an infinite error. Ranks order it behind every finite one, so that divergences
are neither dropped nor given a number; two that both diverged are a tie. The median of differences does not
see a minority of infinite ones, nor any where most are zero: how many there are is told beside it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from orchestrator.evidence.bootstrap import CONFIDENCE
from orchestrator.evidence.intervals import Interval, share
from orchestrator.evidence.permutation import accepted, rank_sum_test, signed_rank_test
from orchestrator.score.gather import Floats, Ints

PAIRED_EFFECT = "matched-pairs rank biserial"
UNPAIRED_EFFECT = "Cliff's delta"


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
        Hodges-Lehmann estimate of A - B, and between which ends the test rejects no shift; infinite ends are
        those that no finite number bounds, NaN ones say that it rejects every shift.
    statistic
        Of the test: the sum of signed ranks or, unpaired, how far A's sum of ranks is above its mean. Its
        sign tells which one is the larger.
    p_value
        Two-sided, of the Wilcoxon signed-rank test or, unpaired, the Mann-Whitney test.
    effect_name, effect
        The effect size, from -1 (A is always the smaller) to 1 (A is always the larger).
    least_p
        The smallest p value that samples of these sizes can give: above the level they are too few.
    identical
        Whether no pair differs.
    is_shift
        Whether a shift describes how they differ: at most half of the pairs (unpaired: of every A with every
        B) are tied, and the test leaves some shift.
    means
        The mean of A and of B.
    infinite
        In how many values A and B are infinite.
    infinite_alone
        In how many pairs A alone and B alone is infinite; unpaired the same as ``infinite``.
    finite
        The difference over those pairs, or values, that are finite; None where no infinite one stands alone.
    counts
        In how many pairs A is smaller, as large, and larger; None when unpaired.
    smaller
        The share of those pairs that differ in which A is the smaller one, with the exact interval that
        belongs to the sign test (Clopper and Pearson 1934); None when unpaired or when none differs.
    """

    paired: bool
    sizes: tuple[int, int]
    shift: Interval
    statistic: float
    p_value: float
    effect_name: str
    effect: float
    least_p: float
    identical: bool
    is_shift: bool
    means: tuple[float, float]
    infinite: tuple[int, int]
    infinite_alone: tuple[int, int]
    finite: Difference | None = None
    counts: tuple[int, int, int] | None = None
    smaller: Interval | None = None


_UNKNOWN = Interval(np.nan, np.nan, np.nan)


def paired_difference(a: Floats, b: Floats, confidence: float = CONFIDENCE) -> Difference:
    """Return how paired values (N,) differ: Wilcoxon's signed-rank test (1945, Biometrics Bulletin 1:80).

    Zero differences keep their ranks (Pratt 1959, JASA 54:655). The estimate is the median of the Walsh
    averages, its interval that of Hodges and Lehmann (1963, Ann. Math. Stat. 34:598): the shifts that the
    test does not reject, whatever is tied. The effect size is the matched-pairs rank biserial correlation
    (Kerby 2014). Neither may hold NaN.
    """
    with np.errstate(invalid="ignore"):
        differences = np.where(a == b, 0.0, a - b)
    n = differences.size
    less, more = int(np.sum(differences < 0.0)), int(np.sum(differences > 0.0))
    p_value, statistic = signed_rank_test(differences)
    shift = Interval(0.0, 0.0, 0.0) if n else _UNKNOWN
    if less + more:
        shift = _shift_of_pairs(differences, 1.0 - confidence)
    _, signed = signed_rank_test(differences[differences != 0.0])
    alone = (int(np.sum(np.isinf(a) & ~np.isinf(b))), int(np.sum(np.isinf(b) & ~np.isinf(a))))
    both = np.isfinite(a) & np.isfinite(b)
    return Difference(
        paired=True,
        sizes=(n, n),
        shift=shift,
        statistic=statistic,
        p_value=p_value,
        effect_name=PAIRED_EFFECT,
        effect=2.0 * signed / ((less + more) * (less + more + 1) or 1),
        least_p=least_p(True, n, n),
        identical=n > 0 and not less + more,
        is_shift=not less + more or (2 * (less + more) >= n and not math.isnan(shift.low)),
        means=(_mean(a), _mean(b)),
        infinite=(int(np.isinf(a).sum()), int(np.isinf(b).sum())),
        infinite_alone=alone,
        finite=paired_difference(a[both], b[both], confidence) if any(alone) else None,
        counts=(less, n - less - more, more),
        smaller=share(less, less + more, confidence, "exact") if less + more else None,
    )


def unpaired_difference(a: Floats, b: Floats, confidence: float = CONFIDENCE) -> Difference:
    """Return how independent values (N,) and (M,) differ: the test of Mann and Whitney (1947).

    The estimate is the median of all differences with the interval of Hodges and Lehmann, the shifts that the
    test does not reject; the effect size is Cliff's delta (1993, Psychological Bulletin 114:494). Neither may
    hold NaN.
    """
    n, m = a.size, b.size
    p_value, statistic, effect, shift, tied = 1.0, 0.0, 0.0, _UNKNOWN, 0.0
    if n and m:
        joined, largest = _clipped(np.concatenate([a, b]))
        apart = joined[:n, None] - joined[None, n:]
        effect, tied = float(np.mean(np.sign(apart))), float(np.mean(apart == 0.0))
        p_value, statistic = rank_sum_test(a, b)
        with np.errstate(invalid="ignore"):
            steps = a[:, None] - b[None, :]
        ends = accepted(_finite(steps), lambda by: rank_sum_test(a - by, b), 1.0 - confidence)
        shift = Interval(_median(apart, largest), *ends)
    infinite = (int(np.isinf(a).sum()), int(np.isinf(b).sum()))
    finite = (a[np.isfinite(a)], b[np.isfinite(b)])
    return Difference(
        paired=False,
        sizes=(n, m),
        shift=shift,
        statistic=statistic,
        p_value=p_value,
        effect_name=UNPAIRED_EFFECT,
        effect=effect,
        least_p=least_p(False, n, m) if n and m else 1.0,
        identical=False,
        is_shift=tied <= 0.5 and not math.isnan(shift.low),
        means=(_mean(a), _mean(b)),
        infinite=infinite,
        infinite_alone=infinite,
        finite=unpaired_difference(*finite, confidence) if any(infinite) else None,
    )


def _shift_of_pairs(differences: Floats, level: float) -> Interval:
    """Return the median of the Walsh averages of differences (N,), and the shifts that the test accepts."""
    first, second = np.triu_indices(differences.size)
    values, largest = _clipped(differences)
    averages = 0.5 * values[first] + 0.5 * values[second]
    known = np.isfinite(differences)
    steps = _finite(averages[known[first] & known[second]])
    ends = accepted(steps, lambda by: signed_rank_test(differences - by), level)
    return Interval(_median(averages, largest), *ends)


def least_p(paired: bool, first: int, second: int) -> float:
    """Return the smallest p value that samples of these sizes can give."""
    if paired:
        return float(min(1.0, 2.0 ** (1 - first)))
    return min(1.0, 2 / math.comb(first + second, first))


def _mean(values: Floats) -> float:
    """Return the mean, NaN of nothing and of infinities of both signs."""
    with np.errstate(invalid="ignore", over="ignore"):
        return float(np.mean(values)) if values.size else math.nan


def _finite(values: Floats) -> Floats:
    """Return the finite ones of some values, each once, ascending."""
    return np.unique(values[np.isfinite(values)])


def _clipped(values: Floats) -> tuple[Floats, float]:
    """Return values with infinities made finite, far beyond all others, and how large they became."""
    known = np.abs(values[np.isfinite(values)])
    largest = 1e12 * max(float(known.max(initial=0.0)), 1e-100)
    return np.clip(values, -largest, largest), largest


def _median(values: Floats, largest: float) -> float:
    """Return the median of figures of clipped values, infinite where it is of an infinite one."""
    median = float(np.median(values))
    return math.copysign(math.inf, median) if abs(median) > largest / 4.0 else median


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
