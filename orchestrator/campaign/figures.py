"""The figures of a campaign's summary: medians over trials, trials in which something happened, and rates."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from orchestrator.evidence.bootstrap import CONFIDENCE
from orchestrator.evidence.intervals import Interval, median_of_trials, share
from orchestrator.evidence.rates import pooled_rate
from orchestrator.evidence.samples import together
from orchestrator.score.gather import Floats, Ints

Kind = Literal["median", "trials", "rate"]

COUNTED = frozenset({"divergences"})
"""Metrics of which a summary tells in how many trials there was any: most are 0, and so is their median."""

RATES: Mapping[str, bool] = {"detector.recall": True, "detector.false_alarm_rate": False}
"""Rates over the packets of all trials: those of attacked packets, or of genuine ones, that were rejected."""


@dataclass(frozen=True)
class Figure:
    """A figure over ``trials`` trials, and its interval over them; NaN where they are too few.

    ``median`` is that of the trials' values, ``trials`` the share of trials with an event, ``rate`` that of
    packets with one, over all trials. Of the latter two ``events`` and ``chances`` are the counts.
    """

    kind: Kind
    value: Interval
    trials: int
    events: int = 0
    chances: int = 0

    def facts(self) -> dict[str, float | int | str | None]:
        """Return the figure for JSON, which has no infinity."""
        name = {"median": "median", "trials": "share", "rate": "rate"}[self.kind]
        found = {name: self.value.value, "low": self.value.low, "high": self.value.high}
        facts: dict[str, float | int | str | None] = {key: _plain(value) for key, value in found.items()}
        if self.kind == "trials":
            facts["with"] = self.events
        if self.kind == "rate":
            facts |= {"rejected": self.events, "packets": self.chances}
        return {**facts, "trials": self.trials}


def _plain(value: float) -> float | str | None:
    return None if math.isnan(value) else "unbounded" if math.isinf(value) else value


def over_trials(
    metric: str, values: Floats, trial: Ints, trials: int, confidence: float = CONFIDENCE
) -> Figure | None:
    """Return the figure of a metric, given its values (R,) and the trial (R,) of each, below ``trials``.

    Values of one trial are put together as in a comparison. None where no trial has one.
    """
    found = together(metric, values, trial, trials)
    known = found[~np.isnan(found)]
    if not known.size:
        return None
    if metric not in COUNTED:
        return Figure("median", median_of_trials(known, confidence), known.size)
    events = int(np.sum(known > 0.0))
    return Figure("trials", share(events, known.size, confidence), known.size, events, known.size)


def rates_of_packets(
    rejected: Floats, packets: Floats, confidence: float = CONFIDENCE
) -> list[Figure | None]:
    """Return the rate at which packets are rejected at each of K points, given counts (T, K) by trial."""
    band = pooled_rate(rejected, packets, confidence)
    figures: list[Figure | None] = []
    for k, chances in enumerate(packets.sum(axis=0).astype(int).tolist()):
        interval = Interval(float(band.value[k]), float(band.low[k]), float(band.high[k]))
        events, trials = int(rejected[:, k].sum()), int(np.sum(packets[:, k] > 0.0))
        figures.append(Figure("rate", interval, trials, events, chances) if chances else None)
    return figures
