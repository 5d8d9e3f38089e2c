"""What a threshold buys: detection delay against the mean time between false alarms.

The threshold is swept over the recorded statistics. That is exact for a detector that only flags, and
approximate for one whose rejections change the estimates: see `orchestrator.evidence.roc`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orchestrator.evidence.bootstrap import CONFIDENCE
from orchestrator.evidence.survival import Survival, kaplan_meier
from orchestrator.score.gather import Bools, Floats, Ints

POINTS = 30
"""Thresholds that a curve is drawn through."""


@dataclass(frozen=True)
class Windows:
    """Attack windows (W,): trial, link, first and last step in which an alarm counts as detection.

    Links are numbered over all trials alike.
    """

    trial: Ints
    link: Ints
    first: Ints
    end: Ints


@dataclass(frozen=True)
class Judged:
    """Judged packets (P,): trial, link, step of delivery, statistic, and whether it was attacked."""

    trial: Ints
    link: Ints
    step: Ints
    statistic: Floats
    attacked: Bools


@dataclass(frozen=True)
class Point:
    """One threshold: steps of a link between two false alarms (infinite: none), and the delays."""

    threshold: float
    between_false_alarms: float
    delay: Survival


def _running_peaks(judged: Judged, windows: Windows) -> list[tuple[Ints, Floats]]:
    """Return for each window the steps of its packets, and the largest statistic until then."""
    order = np.lexsort((judged.step, judged.link, judged.trial))
    trial, link, step = judged.trial[order], judged.link[order], judged.step[order]
    statistic = judged.statistic[order]
    span = int(max(link.max(initial=0), windows.link.max(initial=0))) + 1
    place = trial * span + link
    peaks = []
    for key, first, end in zip(windows.trial * span + windows.link, windows.first, windows.end, strict=True):
        begin, stop = np.searchsorted(place, [key, key + 1])
        inside = slice(
            begin + int(np.searchsorted(step[begin:stop], first)),
            begin + int(np.searchsorted(step[begin:stop], end, side="right")),
        )
        peaks.append((step[inside], np.maximum.accumulate(statistic[inside])))
    return peaks


def _delays(peaks: list[tuple[Ints, Floats]], windows: Windows, threshold: float) -> tuple[Ints, Bools]:
    """Return the delay (W,) of each window at a threshold, and whether it was found: else it is censored."""
    delay, found = windows.end - windows.first, np.zeros(windows.first.size, dtype=bool)
    for i, (steps, peak) in enumerate(peaks):
        at = int(np.searchsorted(peak, threshold, side="left"))
        if at < steps.size:
            delay[i], found[i] = steps[at] - windows.first[i], True
    return delay, found


def between_false_alarms(judged: Judged, threshold: float) -> float:
    """Return the mean number of judged genuine packets between two that are rejected; infinite for none.

    A link delivers at most one packet a step where nothing is delayed or doubled, so that it is a time in
    steps of a link.
    """
    genuine = judged.statistic[~judged.attacked]
    alarms = int(np.sum(genuine >= threshold))
    return genuine.size / alarms if alarms else np.inf


def operating_curve(
    judged: Judged,
    windows: Windows,
    points: int = POINTS,
    confidence: float = CONFIDENCE,
    resamples: int = 500,
) -> list[Point]:
    """Return delay against time between false alarms, from lenient thresholds to strict ones.

    The thresholds are such that the false-alarm rates are evenly spread in their logarithms.
    """
    genuine = np.sort(judged.statistic[~judged.attacked])
    if not genuine.size or not windows.first.size:
        return []
    ranks = np.unique(np.geomspace(1, genuine.size, points).round().astype(np.int64))[::-1]
    beyond = np.nextafter(genuine[-1], np.inf)
    thresholds = np.unique(np.append(genuine[genuine.size - ranks], beyond))
    peaks = _running_peaks(judged, windows)
    horizon = int(np.max(windows.end - windows.first))
    curve = []
    for threshold in thresholds:
        delay, found = _delays(peaks, windows, threshold)
        survival = kaplan_meier(
            delay, found, windows.trial, horizon=horizon, confidence=confidence, resamples=resamples
        )
        curve.append(Point(float(threshold), between_false_alarms(judged, threshold), survival))
    return curve
