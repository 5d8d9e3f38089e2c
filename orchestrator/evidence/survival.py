"""Detection delays, some of them censored: an attack that was not found took *longer* than it was watched.

The survival function ``S(t) = P(delay > t)`` is that of Kaplan and Meier (1958, JASA 53:457): a missed attack
counts among those at risk as long as it was watched, and is neither dropped nor taken for a detection at its
end. Intervals resample whole trials, since the windows of one trial are not independent; where all trials
are alike they are those of `orchestrator.evidence.rates`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orchestrator.evidence.bootstrap import CONFIDENCE, RESAMPLES, Band, Statistic, bootstrap
from orchestrator.evidence.intervals import Interval, only
from orchestrator.evidence.rates import with_unseen
from orchestrator.score.gather import Bools, Floats, Ints


@dataclass(frozen=True)
class Survival:
    """What delays (in steps) show, from 0 to ``horizon``.

    ``survival``, ``low``, ``high`` (horizon + 1,): the probability that an attack is not found within t
    steps. ``median`` is the first t at which at least half are found (infinite: never within the horizon);
    its interval reaches from the first t at which ``low`` is down to one half to the first at which ``high``
    is (Brookmeyer and Crowley 1982, Biometrics 38:29). ``restricted_mean`` is the mean of the smaller one of
    delay and ``horizon + 1``. ``windows`` were watched and ``found`` of them detected.
    """

    survival: Floats
    low: Floats
    high: Floats
    median: Interval
    restricted_mean: Interval
    horizon: int
    windows: int
    found: int


_UNKNOWN = Interval(np.nan, np.nan, np.nan)
_NOTHING = Survival(np.zeros(0), np.zeros(0), np.zeros(0), _UNKNOWN, _UNKNOWN, 0, 0, 0)


def _tables(delay: Ints, found: Bools, trial: Ints, trials: int, horizon: int) -> tuple[Floats, Floats]:
    """Return detections and endings of any sort by trial and time, (trials, horizon + 1)."""
    detections, endings = (np.zeros((trials, horizon + 1)) for _ in range(2))
    np.add.at(endings, (trial, delay), 1.0)
    np.add.at(detections, (trial[found], delay[found]), 1.0)
    return detections, endings


def _curve(detections: Floats, endings: Floats) -> Statistic:
    def survival(weights: Floats) -> Floats:
        ended, found = np.matmul(weights, endings), np.matmul(weights, detections)
        at_risk = np.cumsum(ended[:, ::-1], axis=1)[:, ::-1]
        hazard = np.divide(found, at_risk, out=np.zeros_like(found), where=at_risk > 0.0)
        product: Floats = np.cumprod(1.0 - hazard, axis=1)
        product[at_risk[:, 0] <= 0.0] = np.nan
        return product

    return survival


def kaplan_meier(
    delay: Ints,
    found: Bools,
    trial: Ints | None = None,
    *,
    horizon: int | None = None,
    confidence: float = CONFIDENCE,
    resamples: int = RESAMPLES,
) -> Survival:
    """Return the survival function of detection delays.

    Parameters
    ----------
    delay
        Steps from the start of each attack window (W,) to its detection, or to the last step watched.
    found
        Whether it was detected (W,); otherwise the delay is censored: it is longer than that.
    trial
        The number of the trial of each window (W,), from 0; None when each is a trial of its own.
    horizon
        Last step to look at, by default the longest time that any window was watched. Beyond it every
        window counts as censored there.
    confidence, resamples
        Of the intervals.
    """
    if not delay.size:
        return _NOTHING
    trial = np.arange(delay.size) if trial is None else trial
    last = int(delay.max()) if horizon is None else horizon
    within = found & (delay <= last)
    _, dense = np.unique(trial, return_inverse=True)
    trials = int(dense.max()) + 1
    curve = _curve(*_tables(np.minimum(delay, last), within, dense, trials, last))

    def mean(weights: Floats) -> Floats:
        total: Floats = curve(weights).sum(axis=1, keepdims=True)
        return total

    resampled, average = (
        bootstrap(statistic, trials, confidence=confidence, resamples=resamples)
        for statistic in (curve, mean)
    )
    band = with_unseen(resampled, _telling(delay, within, dense, trials, last), confidence)
    restricted = only(average)
    if restricted.low == restricted.high:
        restricted = Interval(restricted.value, float(band.low.sum()), float(band.high.sum()))
    windows, detected = int(delay.size), int(within.sum())
    return Survival(band.value, band.low, band.high, _median(band), restricted, last, windows, detected)


def _telling(delay: Ints, found: Bools, trial: Ints, trials: int, horizon: int) -> Ints:
    """Return how many trials tell at each time (horizon + 1,) whether a window was found by then."""
    last_told = np.zeros(trials, dtype=np.int64)
    np.maximum.at(last_told, trial, np.where(found, horizon, delay))
    telling: Ints = np.sum(last_told[:, None] >= np.arange(horizon + 1), axis=0)
    return telling


def _median(band: Band) -> Interval:
    def first(curve: Floats) -> float:
        half = curve <= 0.5
        return np.nan if np.isnan(curve).any() else float(half.argmax()) if half.any() else np.inf

    return Interval(*(first(curve) for curve in (band.value, band.low, band.high)))
