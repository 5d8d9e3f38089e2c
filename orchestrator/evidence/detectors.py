"""What the rows of one variant show of its detectors: rates, ROC, delays and what a threshold buys."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orchestrator.evidence.bootstrap import CONFIDENCE
from orchestrator.evidence.columns import Rows
from orchestrator.evidence.intervals import Interval, only
from orchestrator.evidence.operating import POINTS, Judged, Point, Windows, operating_curve
from orchestrator.evidence.rates import pooled_rate
from orchestrator.evidence.roc import Roc, roc
from orchestrator.evidence.survival import Survival, kaplan_meier


@dataclass(frozen=True)
class Detection:
    """Detectors over all trials. Rates and delays are those of the threshold that was run.

    ``between_false_alarms`` is the mean number of genuine packets of judged links by false alarm: infinite
    without any, and then its interval still tells how few there may be.
    ``curve`` sweeps the threshold over the recorded statistics: see `orchestrator.evidence.operating`.
    """

    recall: Interval
    false_alarm_rate: Interval
    between_false_alarms: Interval
    delay: Survival
    roc: Roc
    curve: list[Point]


def judged_packets(rows: Rows) -> Judged:
    """Return the packets on which a detector gave a verdict."""
    row, statistic = rows.flat("packet.statistic")
    links = rows.flat("packet.link")[1]
    numbers = _numbers(rows)
    link = np.array([numbers[name] for name in links], dtype=np.int64)
    step, attacked = (rows.flat(f"packet.{name}")[1] for name in ("step", "attacked"))
    kept = ~np.isnan(statistic)
    return Judged(
        rows.trial[row][kept],
        link[kept],
        step[kept].astype(np.int64),
        statistic[kept],
        attacked[kept] == 1.0,
    )


def _numbers(rows: Rows) -> dict[str, int]:
    names = sorted({*rows.flat("packet.link")[1], *rows.flat("window.link")[1]})
    return {name: number for number, name in enumerate(names)}


def attack_windows(rows: Rows) -> tuple[Windows, np.ndarray]:
    """Return the attack windows on judged links, and the delay (W,) that was measured, NaN for a miss."""
    row, delay = rows.flat("window.delay")
    numbers = _numbers(rows)
    link = np.array([numbers[name] for name in rows.flat("window.link")[1]], dtype=np.int64)
    first, end, judged = (rows.flat(f"window.{name}")[1] for name in ("first", "end", "judged"))
    kept = judged == 1.0
    windows = Windows(
        rows.trial[row][kept], link[kept], first[kept].astype(np.int64), end[kept].astype(np.int64)
    )
    return windows, delay[kept]


def delays(rows: Rows, confidence: float = CONFIDENCE) -> Survival:
    """Return the detection delays as measured; a missed attack is longer than it was watched."""
    windows, delay = attack_windows(rows)
    found = ~np.isnan(delay)
    watched = np.where(found, delay, windows.end - windows.first).astype(np.int64)
    return kaplan_meier(watched, found, windows.trial, confidence=confidence)


def detection(rows: Rows, points: int = POINTS, confidence: float = CONFIDENCE) -> Detection:
    """Return all that is known of the detectors of some rows."""
    judged = judged_packets(rows)
    windows, _ = attack_windows(rows)
    alarm_row, alarm = rows.flat("packet.alarm")
    attacked = rows.flat("packet.attacked")[1] == 1.0
    trial = rows.trial[alarm_row]

    def rate(among: np.ndarray) -> Interval:
        alarms, packets = (
            np.bincount(trial, part, rows.trials).astype(np.float64)[:, None]
            for part in (alarm * among, among)
        )
        return only(pooled_rate(alarms, packets, confidence))

    recall, false_alarms = rate(attacked), rate(~attacked)
    return Detection(
        recall,
        false_alarms,
        _between(false_alarms),
        delays(rows, confidence),
        roc(judged.statistic, judged.attacked, judged.trial, confidence),
        operating_curve(judged, windows, points, confidence),
    )


def _between(rate: Interval) -> Interval:
    """Return how many chances there are by event, given the rate of events; infinite for none."""
    value, high, low = (1.0 / part if part else np.inf for part in (rate.value, rate.low, rate.high))
    return Interval(value, low, high)
