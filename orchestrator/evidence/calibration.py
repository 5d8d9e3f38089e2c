"""Whether an announced probability is one: what came true of it, over trials (its calibration).

Statements are put into bins of equal width by the probability p that they announce, and y tells whether it
happened. With N statements in all, the expected calibration error (Naeini, Cooper and Hauskrecht 2015, AAAI
29:2901) is the sum over bins of ``|u|``, where ``u = sum(y - p) / N`` over a bin's statements: the mean
distance of frequency and probability, each bin weighed by its statements.

It is biased. Of a source that is calibrated no ``u`` is exactly zero, so that chance alone makes up an error:
the mean of ``|u|`` is ``sqrt(2 / pi)`` of its standard deviation. And what errs up and down inside one bin
cancels there. Resampled errors hold the bias twice, so that the usual bootstrap intervals miss a calibrated
source nearly always. Here the differences ``d = u* - u`` of resampled trials are used instead:

- the error exceeds the true one by no more than ``sum |d|``, and where the sign of a bin's ``u`` is beyond
  doubt by its signed difference (a choice of moments as in Andrews and Soares 2010, Econometrica 78:119);
- it falls short of the true one by no more than the sum of signed differences.

So the interval of a calibrated source begins at zero at least as often as its confidence says.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orchestrator.evidence.bootstrap import CONFIDENCE, Band, pooled, resampled
from orchestrator.evidence.columns import Rows
from orchestrator.evidence.intervals import Interval
from orchestrator.evidence.rates import pooled_rate
from orchestrator.score.gather import Bools, Floats, Ints

BINS = 20
STATED, HAPPENED = "attack_probability", "attack_on"
"""The columns of what was announced of a signal attack, and of whether there was one."""

_BEYOND_DOUBT = 3.0
"""Standard deviations from zero at which the sign of a bin's error is taken as known."""


@dataclass(frozen=True)
class Calibration:
    """Statements in B bins of equal width over [0, 1], and what came true of them.

    Parameters
    ----------
    count
        (B,) statements in each bin.
    probability
        (B,) the mean of what they announced, NaN in an empty bin.
    frequency
        The share of them that came true, with its interval over trials.
    error
        The expected calibration error. Its interval is NaN for one trial.
    by_chance
        The error that a calibrated source would show on average, in as many trials; NaN for one trial.
    trials
        The trials in which anything was announced.
    """

    count: Ints
    probability: Floats
    frequency: Band
    error: Interval
    by_chance: float
    trials: int


def calibration(
    stated: Floats,
    happened: Bools,
    trial: Ints,
    *,
    bins: int = BINS,
    confidence: float = CONFIDENCE,
) -> Calibration:
    """Return what came true of announced probabilities.

    Parameters
    ----------
    stated
        (N,) probabilities; one outside [0, 1] counts in the outermost bin.
    happened
        (N,) whether it happened.
    trial
        (N,) the trial of each statement: trials are independent, statements inside one need not be.
    bins
        Number of bins.
    confidence
        Probability of the intervals.
    """
    own, number = np.unique(trial, return_inverse=True)
    place = np.clip(np.floor(stated * bins), 0, bins - 1).astype(np.int64)

    def by_trial(values: Floats) -> Floats:
        total = np.zeros((own.size, bins))
        np.add.at(total, (number, place), values)
        return total

    count, announced, true = (
        by_trial(part) for part in (np.ones_like(stated), stated, happened.astype(float))
    )
    held = count.sum(axis=0)
    with np.errstate(invalid="ignore"):
        probability = announced.sum(axis=0) / held
    error, by_chance = _error(true - announced, count.sum(axis=1), confidence)
    return Calibration(
        count=held.astype(np.int64),
        probability=probability,
        frequency=pooled_rate(true, count, confidence),
        error=error,
        by_chance=by_chance,
        trials=own.size,
    )


def _error(missed: Floats, statements: Floats, confidence: float) -> tuple[Interval, float]:
    """Return the expected calibration error with its interval, and that of chance alone.

    ``missed`` (T, B) sums what happened less what was announced, by trial and bin; ``statements`` are (T,).
    """
    trials = statements.size
    if not trials:
        return Interval(np.nan, np.nan, np.nan), np.nan
    u = missed.sum(axis=0) / statements.sum()
    error = float(np.abs(u).sum())
    if trials < 2:
        return Interval(error, np.nan, np.nan), np.nan
    d = resampled(pooled(missed, np.broadcast_to(statements[:, None], missed.shape)), trials) - u
    spread = np.sqrt(np.mean(d**2, axis=0))
    signed = d * np.sign(u)
    surplus = np.where(np.abs(u) > _BEYOND_DOUBT * spread, signed, np.abs(d)).sum(axis=1)
    rare = (1.0 - confidence) / 2.0
    low = error - float(np.quantile(surplus, 1.0 - rare))
    high = error - float(np.quantile(signed.sum(axis=1), rare))
    return Interval(error, max(low, 0.0), high), float(np.sqrt(2.0 / np.pi) * spread.sum())


def speaks_of_attacks(rows: Rows) -> bool:
    """Return whether any row announces the probability of a signal attack, and tells the truth beside it."""
    if not {STATED, HAPPENED} <= set(rows.table.column_names):
        return False
    return bool(np.isfinite(rows.flat(STATED)[1]).any())


def attack_calibration(
    rows: Rows, from_step: int = 0, *, bins: int = BINS, confidence: float = CONFIDENCE
) -> Calibration:
    """Return what came true of the probability of a signal attack, over all trials of some estimators.

    What was said of steps before ``from_step``, or from an estimator's divergence on, does not count.
    """
    stated, happened = rows.series(STATED), rows.series(HAPPENED)
    diverged = rows.scalar("divergence_step")[:, None]
    step = np.arange(stated.shape[1])
    counted = (step >= from_step) & ~(step >= diverged) & ~np.isnan(stated) & ~np.isnan(happened)
    trial = np.broadcast_to(rows.trial[:, None], stated.shape)
    return calibration(
        stated[counted], happened[counted] == 1.0, trial[counted], bins=bins, confidence=confidence
    )
