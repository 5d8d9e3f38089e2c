"""Rank tests by their permutation law: exact for small samples, whatever is tied or zero.

Where nothing differs, each sign of a paired difference, or each parting of the joined values, is as likely as
any other. The law of a sum of ranks follows by counting; midranks are whole numbers when doubled, so ties
need no approximation. The interval of a shift is what such a test does not reject.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from orchestrator.score.gather import Floats, Ints

EXACT = 50
"""Values that differ from zero (paired) or values of both together up to which the law is counted out."""

_MOST = float(np.finfo(np.float64).max)

RankTest = Callable[[float], tuple[float, float]]
"""From a shift to the p value of its hypothesis, and the sign of what is left of the difference."""


def signed_rank_test(differences: Floats) -> tuple[float, float]:
    """Return the two-sided p value of Wilcoxon's signed-rank test and the signed sum of ranks.

    Zeros of the differences (N,) keep their ranks (Pratt 1959, JASA 54:655), equal sizes share the mean of
    theirs, infinite ones are tied. With more than `EXACT` that are not zero the sum is taken for normal, with
    the mean and variance of its own law.
    """
    ranks = _doubled_ranks(np.abs(differences))
    moved = differences != 0.0
    own = ranks[moved]
    total, signed = int(own.sum()), int(np.sum(np.sign(differences[moved]) * own))
    if own.size > EXACT:
        p_value = _normal(abs(signed), float(np.sum(own.astype(np.float64) ** 2)))
    else:
        lesser = (total - abs(signed)) // 2
        ways = np.zeros(lesser + 1)
        ways[0] = 1.0
        for rank in own[own <= lesser]:
            ways[rank:] = ways[rank:] + ways[:-rank]
        p_value = min(1.0, 2.0 * float(ways.sum()) / 2.0**own.size)
    return p_value, signed / 2.0


def rank_sum_test(a: Floats, b: Floats) -> tuple[float, float]:
    """Return the two-sided p value of the test of Mann and Whitney, and how far above its mean A's sum is.

    Equal values of A (N,) and B (M,) share the mean of their ranks, infinite ones are tied. With more than
    `EXACT` values in all the sum is taken for normal, with its own variance and corrected for continuity.
    """
    ranks = _doubled_ranks(np.concatenate([a, b]))
    n, number = a.size, ranks.size
    above = float(ranks[:n].sum()) - n * float(ranks.mean())
    if number > EXACT:
        variance = n * (number - n) / (number * (number - 1)) * float(np.sum((ranks - ranks.mean()) ** 2))
        return _normal(max(abs(above) - 1.0, 0.0), variance), above / 2.0
    rarer, observed = (n, ranks[:n].sum()) if 2 * n <= number else (number - n, ranks[n:].sum())
    ways = np.zeros((rarer + 1, int(ranks.sum()) + 1))
    ways[0, 0] = 1.0
    for rank in ranks:
        ways[1:, rank:] = ways[1:, rank:] + ways[:-1, :-rank]
    tail = min(ways[rarer, : observed + 1].sum(), ways[rarer, observed:].sum())
    return min(1.0, 2.0 * float(tail) / math.comb(number, rarer)), above / 2.0


def accepted(steps: Floats, test: RankTest, level: float) -> tuple[float, float]:
    """Return the ends of the shifts that a test does not reject at a level; NaN where it rejects every one.

    ``steps`` (K,) are the finite shifts, ascending, at which the test's answer may change. As the shift grows
    what is left of the difference falls, so each end is found by bisection over the steps and the gaps
    between them. An end is infinite where the test rejects no shift on that side.
    """
    last = 2 * steps.size

    def side(cell: int) -> int:
        """Return by its sign on which side of what is accepted a step (odd) or a gap (even) is."""
        with np.errstate(over="ignore"):
            p_value, left = test(_shift(steps, cell))
        return 0 if p_value > level else (1 if left > 0.0 else -1)

    first = _first(last + 1, lambda cell: side(cell) <= 0)
    beyond = _first(last + 1, lambda cell: side(cell) < 0)
    if first >= beyond:
        return math.nan, math.nan
    low = -math.inf if first == 0 else float(steps[(first - 1) // 2])
    high = math.inf if beyond == last + 1 else float(steps[(beyond - 1) // 2])
    return low, high


def _shift(steps: Floats, cell: int) -> float:
    """Return a step (odd cells) or a shift in the gap between two, or before or after all (even)."""
    if not steps.size:
        return 0.0
    if cell % 2:
        return float(steps[cell // 2])
    with np.errstate(over="ignore"):
        apart = 1.0 + steps[-1] - steps[0]
        before = steps[cell // 2 - 1] if cell else steps[0] - apart
        after = steps[cell // 2] if cell < 2 * steps.size else steps[-1] + apart
    return float(np.clip(0.5 * before + 0.5 * after, -_MOST, _MOST))


def _first(count: int, holds: Callable[[int], bool]) -> int:
    """Return the first of some whole numbers from which on something holds; ``count`` where nowhere."""
    low, high = 0, count
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if holds(middle) else (middle + 1, high)
    return low


def _doubled_ranks(values: Floats) -> Ints:
    """Return twice the ranks (N,) from 1 on, equal values sharing the mean of theirs."""
    _, at, counts = np.unique(values, return_inverse=True, return_counts=True)
    doubled: Ints = (2 * np.cumsum(counts) - counts + 1)[at]
    return doubled


def _normal(distance: float, variance: float) -> float:
    """Return the two-sided p value of a distance from the mean of a normal law."""
    from scipy.special import ndtr

    return float(2.0 * ndtr(-distance / math.sqrt(variance))) if variance > 0.0 else 1.0
