"""Intervals by resampling whole trials: what happens inside a trial is correlated, trials are independent.

A statistic is told how often each trial counts and answers for many such weightings at once. The interval is
the bias-corrected and accelerated one (BCa; Efron 1987, JASA 82:171; Efron and Tibshirani 1993, chapter 14),
whose acceleration comes from leaving out one trial at a time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bus.random_streams import random_stream
from orchestrator.score.gather import Bools, Floats

Statistic = Callable[[Floats], Floats]
"""From weights (B, N) of N trials to the statistic (B, K) under each weighting; NaN where undefined."""

RESAMPLES = 2000
CONFIDENCE = 0.95
_ROWS = 256
"""Weightings that a statistic is asked about at a time, to bound the memory."""


@dataclass(frozen=True)
class Band:
    """A curve (K,) and its pointwise interval (K,): NaN where undefined or where one trial is too few."""

    value: Floats
    low: Floats
    high: Floats


def bootstrap(
    statistic: Statistic,
    trials: int,
    *,
    confidence: float = CONFIDENCE,
    resamples: int = RESAMPLES,
    seed: int = 0,
) -> Band:
    """Return a statistic of all trials and its BCa interval at each of its K points.

    Parameters
    ----------
    statistic
        What to estimate, as a function of how often each trial counts.
    trials
        Number N of trials.
    confidence
        Probability of the two-sided interval.
    resamples
        Number of bootstrap samples.
    seed
        Of the resampling: the same seed gives the same interval.
    """
    value = statistic(np.ones((1, trials)))[0]
    if trials < 2:
        unknown = np.full(value.shape, np.nan)
        return Band(value, unknown, unknown.copy())
    drawn = resampled(statistic, trials, resamples=resamples, seed=seed)
    left_out = _without_each(statistic, trials)
    low, high = (
        _quantiles(drawn, _adjusted(value, drawn, left_out, share))
        for share in ((1.0 - confidence) / 2.0, (1.0 + confidence) / 2.0)
    )
    return Band(value, np.where(np.isnan(value), np.nan, low), np.where(np.isnan(value), np.nan, high))


def resampled(statistic: Statistic, trials: int, *, resamples: int = RESAMPLES, seed: int = 0) -> Floats:
    """Return a statistic (resamples, K) of as many trials, drawn from those there are with replacement."""
    rng = random_stream(seed, 0, "evidence", "bootstrap")
    even = np.full(trials, 1.0 / trials)
    sizes = (min(_ROWS, resamples - begin) for begin in range(0, resamples, _ROWS))
    drawn = (rng.multinomial(trials, even, size).astype(np.float64) for size in sizes)
    return np.concatenate([statistic(counts) for counts in drawn])


def _without_each(statistic: Statistic, trials: int) -> Floats:
    """Return a statistic (trials, K) of all trials but one, for each that is left out."""
    parts = []
    for begin in range(0, trials, _ROWS):
        weights = np.ones((min(_ROWS, trials - begin), trials))
        np.fill_diagonal(weights[:, begin:], 0.0)
        parts.append(statistic(weights))
    return np.concatenate(parts)


def _adjusted(value: Floats, drawn: Floats, left_out: Floats, share: float) -> Floats:
    """Return the share (K,) of the bootstrap distribution at which the BCa interval ends."""
    from scipy.special import ndtr, ndtri

    known = np.maximum(np.sum(~np.isnan(drawn), axis=0), 1)
    below = (np.sum(drawn < value, axis=0) + 0.5 * np.sum(drawn == value, axis=0)) / known
    edge = 0.5 / known
    bias = ndtri(np.clip(below, edge, 1.0 - edge))
    finite = np.isfinite(left_out)
    counts = np.maximum(finite.sum(axis=0), 1)
    kept = np.where(finite, left_out, 0.0)
    away = np.where(finite, kept.sum(axis=0) / counts - kept, 0.0)
    spread = np.sum(away**2, axis=0) ** 1.5
    skew = np.sum(away**3, axis=0)
    acceleration = np.divide(skew, 6.0 * spread, out=np.zeros_like(skew), where=spread > 0.0)
    normal = bias + ndtri(share)
    adjusted: Floats = ndtr(bias + normal / (1.0 - acceleration * normal))
    return adjusted


def _quantiles(drawn: Floats, shares: Floats) -> Floats:
    """Return for each column its own quantile, NaN left out; infinities take part in the order."""
    ordered = np.sort(drawn, axis=0)
    known = np.sum(~np.isnan(drawn), axis=0)
    position = np.clip(shares, 0.0, 1.0) * np.maximum(known - 1, 0)
    lower = np.floor(position).astype(np.int64)
    upper = np.minimum(lower + 1, np.maximum(known - 1, 0))
    columns = np.arange(drawn.shape[1])
    below, above = ordered[lower, columns], ordered[upper, columns]
    part = position - lower
    with np.errstate(invalid="ignore"):
        between = below + part * (above - below)
    found: Floats = np.where(below == above, below, between)
    return found


def pooled(
    numerator: Floats, denominator: Floats, transform: Callable[[Floats], Floats] | None = None
) -> Statistic:
    """Return the statistic ``transform(sum of numerators / sum of denominators)`` over trials.

    ``numerator`` and ``denominator`` are (N, K). A mean has ones below, a rate its number of chances; NaN in
    either leaves that trial out at that point.
    """
    known = ~(np.isnan(numerator) | np.isnan(denominator))
    above, below = (np.where(known, part, 0.0) for part in (numerator, denominator))

    def statistic(weights: Floats) -> Floats:
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = np.matmul(weights, above) / np.matmul(weights, below)
        return ratio if transform is None else transform(ratio)

    return statistic


def root_mean_square(norms: Floats, counted: Bools | None = None) -> Statistic:
    """Return the root mean square over trials of error norms (N, K), over those ``counted`` (N, K)."""
    kept = ~np.isnan(norms) if counted is None else counted & ~np.isnan(norms)
    squares = np.where(kept, np.square(np.where(kept, norms, 0.0)), np.nan)
    return pooled(squares, np.ones_like(squares), np.sqrt)
