"""What a difference in a metric means: which side is the better one, and how estimators are put together."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Literal

DELAY = "detector.delay"
"""The one metric of attack windows that trials are compared by: its mean over a trial's windows."""


class Better(Enum):
    """Which of two values is the better one."""

    LESS = "less"
    MORE = "more"
    ONE = "closer to 1"
    NEITHER = "neither"


@dataclass(frozen=True)
class Meaning:
    """How to read a metric, and how the values of several estimators of a trial make one."""

    better: Better
    together: Literal["rms", "sum", "max", "mean"]


_FAMILIES = {
    "rmse": Meaning(Better.LESS, "rms"),
    "rmse_attacked": Meaning(Better.LESS, "rms"),
    "rmse_unattacked": Meaning(Better.LESS, "rms"),
    "peak": Meaning(Better.LESS, "max"),
    "final": Meaning(Better.LESS, "rms"),
    "disagreement": Meaning(Better.LESS, "rms"),
    "divergences": Meaning(Better.LESS, "sum"),
    "missing_estimates": Meaning(Better.LESS, "sum"),
    "lockouts": Meaning(Better.LESS, "sum"),
    "nees.ratio": Meaning(Better.ONE, "mean"),
    "nis.ratio": Meaning(Better.ONE, "mean"),
    "detector.recall": Meaning(Better.MORE, "mean"),
    "detector.precision": Meaning(Better.MORE, "mean"),
    "detector.false_alarm_rate": Meaning(Better.LESS, "mean"),
    "detector.missed_windows": Meaning(Better.LESS, "sum"),
    DELAY: Meaning(Better.LESS, "mean"),
    "attack.probability_on": Meaning(Better.MORE, "mean"),
    "attack.probability_off": Meaning(Better.LESS, "mean"),
    "attack.false_alarms": Meaning(Better.LESS, "sum"),
    "attack.misses": Meaning(Better.LESS, "sum"),
    "attack.detection_delay": Meaning(Better.LESS, "mean"),
    "attack.release_delay": Meaning(Better.LESS, "mean"),
    "attack.rmse": Meaning(Better.LESS, "rms"),
    "recovered.rmse": Meaning(Better.LESS, "rms"),
    "recovered.nees_ratio": Meaning(Better.ONE, "mean"),
    "deviation": Meaning(Better.LESS, "rms"),
    "bound.outside": Meaning(Better.LESS, "mean"),
    "bound.guaranteed": Meaning(Better.MORE, "mean"),
    "packets.lost_share": Meaning(Better.NEITHER, "mean"),
    "packets.mean_loss_burst": Meaning(Better.NEITHER, "mean"),
    "packets": Meaning(Better.NEITHER, "sum"),
    "sent_rate": Meaning(Better.NEITHER, "mean"),
}


def meaning_of(metric: str) -> Meaning:
    """Return how to read a metric; one that is not known here is better nowhere, and averaged."""
    family = metric.partition(".")[0]
    return _FAMILIES.get(metric) or _FAMILIES.get(family) or Meaning(Better.NEITHER, "mean")


def label(metric: str) -> str:
    """Return what trials are compared by: the metric, or the distance from 1 of one that is best there."""
    return f"|log {metric}|" if meaning_of(metric).better is Better.ONE else metric


def is_measured_by_window(metric: str) -> bool:
    """Return whether a metric stands in the columns of attack windows."""
    return metric == DELAY
