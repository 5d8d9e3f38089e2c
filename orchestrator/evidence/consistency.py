"""Whether covariances tell the truth over many trials: average NEES and NIS within two-sided bounds.

All averages are over their degrees of freedom, so that 1 is consistent whatever arrived: the sum of
independent chi-square figures is chi-square with the sum of their degrees of freedom (Bar-Shalom, Li and
Kirubarajan 2001, section 5.4). In one step the trials are independent, so the bounds of each step are exact
for NEES and NIS of a linear Gaussian filter that knows its models. Over steps NIS is independent and NEES is
not, and estimators that follow one plant share its noise: such averages are judged by the spread of the
trials' own averages instead.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from orchestrator.evidence.bootstrap import CONFIDENCE
from orchestrator.score.consistency import chi_square_bounds
from orchestrator.score.gather import Bools, Floats, Ints

Judgement = Literal["consistent", "overconfident", "conservative", "unknown"]

_VAGUE = 0.1
"""Bounds that reach below this say nothing: a filter ten times too careful would be within."""


@dataclass(frozen=True)
class ByStep:
    """The average over trials at each of K steps, over its degrees of freedom, with what is expected.

    ``ratio``, ``low`` and ``high`` are (K,): 1 is consistent, and a consistent filter's ratio lies between
    ``low`` and ``high`` with the confidence asked for. ``dof`` (K,) is the total over trials, ``samples``
    (K,) the number of trials. NaN where there is none.
    """

    ratio: Floats
    low: Floats
    high: Floats
    dof: Ints
    samples: Ints


@dataclass(frozen=True)
class Overall:
    """The average over trials and steps, over its degrees of freedom: 1 is consistent.

    A consistent filter's ``ratio`` lies within ``low`` and ``high`` with the confidence asked for.
    """

    ratio: float
    low: float
    high: float
    samples: int

    @property
    def judgement(self) -> Judgement:
        """What the bounds say: errors larger than believed are overconfidence.

        Bounds that reach down to nearly 0 hold every filter that is too careful: being within says nothing.
        """
        if not self.low <= self.high:
            return "unknown"
        if self.ratio > self.high:
            return "overconfident"
        if self.low < _VAGUE:
            return "unknown"
        return "conservative" if self.ratio < self.low else "consistent"


def _counted(figures: Floats, dof: Ints, counted: Bools | None) -> tuple[Floats, Ints, Bools]:
    """Return figures and degrees of freedom with zeros where they do not count, and where they do."""
    kept = np.isfinite(figures) & (dof > 0)
    if counted is not None:
        kept &= counted
    return np.where(kept, figures, 0.0), np.where(kept, dof, 0), kept


def by_step(
    figures: Floats, dof: Ints, counted: Bools | None = None, confidence: float = CONFIDENCE
) -> ByStep:
    """Return the average of chi-square figures (N, K) over N trials at each step.

    ``dof`` (N, K) may differ between trials and steps, as it does where packets are lost; 0 means no figure.
    """
    values, dof, kept = _counted(figures, dof, counted)
    total = dof.sum(axis=0)
    low, high = chi_square_bounds(np.maximum(total, 1), confidence)
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio, low, high = (part / total for part in (values.sum(axis=0), low, high))
    some = total > 0
    ratio, low, high = (np.where(some, part, np.nan) for part in (ratio, low, high))
    return ByStep(ratio, low, high, dof=total, samples=kept.sum(axis=0))


def overall_independent(
    figures: Floats, dof: Ints, counted: Bools | None = None, confidence: float = CONFIDENCE
) -> Overall:
    """Return the average of chi-square figures (N, K) that are independent over trials and steps: NIS."""
    values, dof, kept = _counted(figures, dof, counted)
    total = int(dof.sum())
    if not total:
        return Overall(np.nan, np.nan, np.nan, 0)
    low, high = chi_square_bounds(np.array([total]), confidence)
    return Overall(
        float(values.sum()) / total, float(low[0]) / total, float(high[0]) / total, int(kept.sum())
    )


def overall_by_trial(
    figures: Floats,
    dof: Ints,
    counted: Bools | None = None,
    confidence: float = CONFIDENCE,
    trial: Ints | None = None,
) -> Overall:
    """Return the average of chi-square figures (N, K) that are independent between trials alone.

    ``trial`` (N,) is the number of the trial that each row is of; without it each row is one. NEES is
    correlated over the steps of a trial, and estimators of one trial have its plant in common.

    The trials' own averages ``m_i`` of mean ``m`` and variance ``s^2`` are taken for scaled chi-squares
    (Satterthwaite 1946): over N trials with ``nu = 2 N m^2 / s^2`` degrees of freedom. As nu is
    estimated, the bounds are those of ``chi^2_nu / nu`` at the normal quantiles that Student's take the
    place of. The quotient ``s / m`` does not depend on ``m`` for such figures, so that campaigns whose
    errors happen to be small are not taken for too careful. NaN for one trial, from which nothing of
    that kind can be said.
    """
    from scipy.special import gammainccinv, gammaincinv, ndtr, stdtrit

    values, dof, kept = _counted(figures, dof, counted)
    if trial is None:
        trial = np.arange(len(values))
    total = np.bincount(trial, dof.sum(axis=1))
    some = total > 0
    means = np.bincount(trial, values.sum(axis=1))[some] / total[some]
    if means.size < 2:
        return Overall(float(means[0]) if means.size else np.nan, np.nan, np.nan, int(kept.sum()))
    mean = float(means.mean())
    spread = float(np.var(means / mean, ddof=1)) if mean > 0.0 else 0.0
    if not spread > 0.0:
        return Overall(mean, 1.0, 1.0, int(kept.sum()))
    shape = float(means.size / spread)  # half of the degrees of freedom
    tail = float(ndtr(-stdtrit(means.size - 1, (1.0 + confidence) / 2.0)))
    low, high = float(gammaincinv(shape, tail)) / shape, float(gammainccinv(shape, tail)) / shape
    return Overall(mean, low, high, int(kept.sum()))
