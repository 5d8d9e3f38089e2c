"""How well a detector's statistic separates attacked packets from genuine ones, whatever the threshold.

The area under the ROC is the probability that an attacked packet has the larger statistic (ties count half).
Packets of one trial are correlated, so its variance is that of clustered data (Obuchowski 1997, Biometrics
53:567), whose clusters are trials; with every packet a cluster of its own it is that of DeLong, DeLong and
Clarke-Pearson (1988, Biometrics 44:837), which a single trial has to make do with. The interval is taken on
the scale of log odds, so that it stays between 0 and 1.

A curve made by sweeping the threshold over *recorded* statistics is approximate where rejected packets are
left out by the estimator: another threshold would have changed the estimates and the statistics after them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from orchestrator.evidence.bootstrap import CONFIDENCE
from orchestrator.evidence.intervals import Interval
from orchestrator.score.gather import Bools, Floats, Ints


@dataclass(frozen=True)
class Roc:
    """The curve as ``threshold``, ``false_alarm_rate`` and ``detection_rate`` (H,), from strict to lenient.

    A packet is rejected when its statistic reaches the threshold; the first threshold is infinite. ``area``
    has its interval by ``unit``: trials, or packets where there is but one trial. All is empty or NaN
    without both attacked and genuine packets.
    """

    threshold: Floats
    false_alarm_rate: Floats
    detection_rate: Floats
    area: Interval
    unit: Literal["trials", "packets"]
    attacked: int
    genuine: int


def roc(statistic: Floats, attacked: Bools, trial: Ints | None = None, confidence: float = CONFIDENCE) -> Roc:
    """Return the ROC of packets (P,) with their statistics, by which were attacked.

    ``trial`` (P,) tells the trial of each packet; None for one trial.
    """
    positive, negative = statistic[attacked], statistic[~attacked]
    by_trial = trial is not None and np.unique(trial).size > 1
    unit: Literal["trials", "packets"] = "trials" if by_trial else "packets"
    if not positive.size or not negative.size:
        nothing = np.zeros(0)
        area = Interval(np.nan, np.nan, np.nan)
        return Roc(nothing, nothing, nothing, area, unit, positive.size, negative.size)
    values = np.unique(statistic)[::-1]
    rates = [
        np.concatenate([[0.0], 1.0 - np.searchsorted(np.sort(part), values, side="left") / part.size])
        for part in (negative, positive)
    ]
    cluster = np.arange(statistic.size) if trial is None or not by_trial else trial
    area = _area(positive, negative, cluster[attacked], cluster[~attacked], confidence)
    thresholds = np.concatenate([[np.inf], values])
    return Roc(thresholds, rates[0], rates[1], area, unit, positive.size, negative.size)


def _placements(values: Floats, others: Floats) -> Floats:
    """Return for each value the share of the others that are below it, ties counted half."""
    ordered = np.sort(others)
    below = np.searchsorted(ordered, values, side="left")
    up_to = np.searchsorted(ordered, values, side="right")
    return np.asarray((below + up_to) / (2.0 * others.size))


def _area(
    positive: Floats, negative: Floats, of_positive: Ints, of_negative: Ints, confidence: float
) -> Interval:
    """Return the area and its interval by clusters (Obuchowski 1997, equations 2 to 6)."""
    from scipy.special import expit, logit, ndtri

    hits, misses = _placements(positive, negative), 1.0 - _placements(negative, positive)
    area = float(hits.mean())
    clusters, place = np.unique(np.concatenate([of_positive, of_negative]), return_inverse=True)
    above, below = place[: positive.size], place[positive.size :]
    count = clusters.size

    def by_cluster(at: Ints, placements: Floats) -> tuple[Floats, int]:
        size = np.bincount(at, minlength=count)
        return np.bincount(at, placements, minlength=count) - size * area, int(np.sum(size > 0))

    (over, with_hits), (under, with_misses) = by_cluster(above, hits), by_cluster(below, misses)
    if min(with_hits, with_misses) < 2 or not 0.0 < area < 1.0:
        return Interval(area, np.nan, np.nan)
    M, N = positive.size, negative.size
    variance = (
        with_hits / (with_hits - 1) * np.sum(over**2) / M**2
        + with_misses / (with_misses - 1) * np.sum(under**2) / N**2
        + 2.0 * count / (count - 1) * np.sum(over * under) / (M * N)
    )
    reach = ndtri((1.0 + confidence) / 2.0) * np.sqrt(max(variance, 0.0)) / (area * (1.0 - area))
    centre = logit(area)
    return Interval(area, float(expit(centre - reach)), float(expit(centre + reach)))
