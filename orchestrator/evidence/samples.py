"""One value of a metric for each trial of a contender.

Where a contender has several estimators, those of a trial make one value: root mean square of root mean
squares, sum of counts, greatest peak, mean of anything else. A ratio that is best at 1 counts by its distance
from 1 in the logarithm. It is taken of each estimator before the mean, lest one above and one below make a
good one; the mean and not the largest, which would grow with their number.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from orchestrator.evidence.columns import Key, Rows
from orchestrator.evidence.detectors import attack_windows
from orchestrator.evidence.metrics import Better, is_measured_by_window, meaning_of
from orchestrator.score.gather import Floats, Ints

_TOGETHER: Mapping[str, Callable[[Floats, Ints, Ints], Floats]] = {
    "rms": lambda values, begins, sizes: np.sqrt(np.add.reduceat(values**2, begins) / sizes),
    "sum": lambda values, begins, sizes: np.add.reduceat(values, begins),
    "max": lambda values, begins, sizes: np.maximum.reduceat(values, begins),
    "mean": lambda values, begins, sizes: np.add.reduceat(values, begins) / sizes,
}
"""What makes one value of several, given where those of each trial begin and how many they are."""


@dataclass(frozen=True)
class Sample:
    """The values of a metric in the trials in which it is known, infinite where unbounded.

    ``failed`` trials came to no score and count as the worst there can be; ``undefined`` ones have no value
    and are left out; ``infinite`` are those without bound, failed ones included.
    """

    keys: Sequence[Key]
    values: Floats
    failed: int
    undefined: int

    @property
    def infinite(self) -> int:
        """The number of values without bound."""
        return int(np.isinf(self.values).sum())

    @property
    def median(self) -> float:
        """The median, NaN of nothing."""
        return float(np.median(self.values)) if self.values.size else np.nan


def sample(rows: Rows, metric: str) -> Sample:
    """Return a metric in each trial of some rows; of one that is best at 1 the mean of its ``|log|``."""
    better = meaning_of(metric).better
    if better is Better.ONE:
        with np.errstate(divide="ignore"):
            off = np.abs(np.log(rows.scalar(metric)))
        values = together(metric, off, rows.trial, rows.trials)
    else:
        values = _by_window(rows) if is_measured_by_window(metric) else by_trial(rows, metric)
    worst = {Better.MORE: -np.inf, Better.NEITHER: np.nan}.get(better, np.inf)
    values = np.where(rows.failed, worst, values)
    known = ~np.isnan(values)
    keys = [key for key, is_known in zip(rows.keys, known, strict=True) if is_known]
    return Sample(keys, values[known], int(rows.failed.sum()), int(np.sum(~known)))


def by_trial(rows: Rows, metric: str) -> Floats:
    """Return a metric's value in each trial (T,), of all its rows together; NaN where undefined or failed."""
    return together(metric, rows.scalar(metric), rows.trial, rows.trials)


def together(metric: str, values: Floats, trial: Ints, trials: int) -> Floats:
    """Return a metric of each trial (T,) from its estimators' values (R,); NaN where none is known.

    ``trial`` (R,) tells the trial of each value, below ``trials``.
    """
    known = ~np.isnan(values)
    order = np.argsort(trial[known], kind="stable")
    present, begins, sizes = np.unique(trial[known][order], return_index=True, return_counts=True)
    found = np.full(trials, np.nan)
    if present.size:
        found[present] = _TOGETHER[meaning_of(metric).together](values[known][order], begins, sizes)
    return found


def _by_window(rows: Rows) -> Floats:
    """Return the mean detection delay of each trial's windows: infinite when one was missed."""
    windows, delay = attack_windows(rows)
    delay = np.where(np.isnan(delay), np.inf, delay)
    count = np.bincount(windows.trial, minlength=rows.trials)
    with np.errstate(invalid="ignore"):
        return np.where(count > 0, np.bincount(windows.trial, delay, rows.trials) / count, np.nan)
