"""From the results of campaigns to the numbers that stand beside a paper's, each with its interval."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from msgspec.structs import replace

from orchestrator.evidence.bootstrap import Band
from orchestrator.evidence.calibration import HAPPENED, STATED, Calibration, attack_calibration
from orchestrator.evidence.columns import Rows, select
from orchestrator.evidence.figures import mean_curve, rmse_curve
from orchestrator.evidence.intervals import Interval, mean_of_trials, median_of_trials, only, share
from orchestrator.evidence.rates import with_unseen
from orchestrator.evidence.samples import by_trial
from orchestrator.evidence.sources import Source, load_source
from orchestrator.evidence.table import SWEPT
from orchestrator.reproduction.claims import CALIBRATION_ERROR, Curve, Place, Points, Statistic, Value
from orchestrator.reproduction.errors import ReproduceError
from orchestrator.score.gather import Floats
from orchestrator.topology.names import select as select_names

FEWEST = 6
"""Fewest trials of which there is an interval: of fewer a median has none, and a mean's says next to nothing.

In 1,500 simulated campaigns each, Student's interval of a mean held in 95 % with any number of trials where
these are normal, and in 88 to 92 % with 5 to 20 where they are exponential. The bootstrap's (BCa) held in 51,
72, 85 and 90 % with 2, 3, 5 and 10 normal ones.
"""

RANGED = 10
"""Fewest trials of which most single runs are told: of fewer, 5 and 95 % are the extremes of chance."""

ENOUGH = 20
"""Trials from which on what is resampled, such as the bands of curves, holds nearly as often as it says."""

SHARES = frozenset(
    {
        *("detector.recall", "detector.precision", "detector.false_alarm_rate", "packets.lost_share"),
        *(
            "attack.probability_on",
            "attack.probability_off",
            "bound.outside",
            "bound.guaranteed",
            "sent_rate",
        ),
    }
)
"""Metrics of which every trial's value is a share."""

_MIDDLE = (0.05, 0.95)
"""The single trials between which most lie."""

_NOWHERE = (math.nan, math.nan)

_MOST_LOG = 700.0
"""Largest logarithm of a number."""


@dataclass(frozen=True)
class Found:
    """A number over trials with its interval, and the range of the single trials' own (5 to 95 %).

    The interval is NaN for fewer than `FEWEST` trials; the range for fewer than `RANGED`, and for what no
    single trial has, such as a share of trials.
    """

    number: Interval
    range: tuple[float, float]
    trials: int


@dataclass
class Results:
    """The results of finished campaigns, by name; each column is read once, when it is asked for."""

    directories: Mapping[str, Path]
    _sources: dict[str, Source] = field(default_factory=dict)

    def source(self, name: str) -> Source:
        """Return a campaign's results."""
        if name not in self._sources:
            self._sources[name] = load_source(self.directories[name])
        return self._sources[name]

    def from_step(self, place: Place) -> int:
        """Return the first step that counts in the averages of a variant."""
        options = self.source(place.campaign).documents[place.variant].get("score") or {}
        return int(options.get("from_step", 0))

    def rows(self, place: Place) -> Rows:
        """Return the rows of some estimators of a variant, with what is needed of a metric."""
        source = self.source(place.campaign)
        wanted = {"variant", "trial", "seed", "node", "method", "status", "divergence_step", "nis_dof"}
        wanted |= {place.metric, HAPPENED} if place.metric == STATED else {place.metric}
        table = source.read(lambda name: name in wanted)
        if place.metric not in table.column_names:
            raise ReproduceError(f"{place.campaign} has no column '{place.metric}' in {source.path}")
        held = list(dict.fromkeys(table.column("node").to_pylist()))
        nodes = [name for pattern in place.nodes for name in select_names(pattern, held)]
        return select(table, variant=place.variant, nodes=nodes or list(place.nodes))


def number(results: Results, value: Value) -> Found:
    """Return a value over trials, or the ratio of it to another in the same trials."""
    if value.over is None:
        return _found(results, value)
    rows, below = results.rows(value), results.rows(value.over)
    values = by_trial(rows, value.metric)
    known = dict(zip(below.keys, by_trial(below, value.over.metric), strict=True))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = values / np.array([known.get(key, np.nan) for key in rows.keys])
    return over_trials(ratio, value.statistic, value.above)


def _found(results: Results, part: Value | Points) -> Found:
    """Return the statistic of a metric in the place that a part names."""
    if part.statistic == CALIBRATION_ERROR:
        told = calibration_of(results, part)
        known = told.error if told.trials >= FEWEST else Interval(told.error.value, *_NOWHERE)
        return Found(known, _NOWHERE, told.trials)
    values = by_trial(results.rows(part), part.metric)
    return over_trials(values, part.statistic, part.above, is_share=part.metric in SHARES)


def calibration_of(results: Results, part: Value | Points) -> Calibration:
    """Return what came true of the probabilities of attack that the estimators of a part announced."""
    return attack_calibration(results.rows(part), results.from_step(part))


def over_trials(values: Floats, statistic: Statistic, above: float = 0.0, *, is_share: bool = False) -> Found:
    """Return a statistic of values (T,), one a trial; undefined ones, NaN, are left out.

    ``is_share`` tells that each value is between 0 and 1, so that its mean is. Where all trials are alike the
    interval of that mean leaves room for those that no trial shows.
    """
    known = values[~np.isnan(values)]
    if not known.size:
        return Found(Interval(math.nan, math.nan, math.nan), _NOWHERE, 0)
    if statistic == "share":
        return Found(share(int(np.sum(known > above)), known.size), _NOWHERE, known.size)
    found = _STATISTICS[statistic](known)
    if is_share and statistic == "mean":
        found = _of_shares(found, known.size)
    if known.size < FEWEST:
        found = Interval(found.value, *_NOWHERE)
    if known.size < RANGED:
        return Found(found, _NOWHERE, known.size)
    low, high = (float(np.quantile(known, q, method="closest_observation")) for q in _MIDDLE)
    return Found(found, (low, high), known.size)


def _mean(known: Floats) -> Interval:
    if not np.isfinite(known).all():
        return Interval(math.inf, math.nan, math.nan)
    return mean_of_trials(known)


def _of_shares(mean: Interval, trials: int) -> Interval:
    """Return the interval of a mean of shares, within 0 and 1, with a width where all trials are alike."""
    sides = (np.array([side]) for side in (mean.value, mean.low, mean.high))
    found = only(with_unseen(Band(*sides), np.array([trials])))
    return Interval(found.value, max(found.low, 0.0), min(found.high, 1.0))


def _rms(known: Floats) -> Interval:
    """Return the root mean square, and Student's interval of the logarithm of the mean square.

    Squares are skewed: on their own scale the interval of a lognormal law (sigma 0.5) held in 81 to 85 % of
    the campaigns of 5 to 20 trials, of the logarithm in 88 to 90 %, and of a normal law in 95 % either way.
    """
    if not np.isfinite(known).all():
        return Interval(math.inf, math.nan, math.nan)
    square = mean_of_trials(known**2)
    root = math.sqrt(square.value)
    if not square.value > 0.0:
        return Interval(root, root, root)
    stretch = math.exp(min((square.high - square.value) / square.value, _MOST_LOG) / 2.0)
    return Interval(root, root / stretch, root * stretch)


def _largest(known: Floats) -> Interval:
    return Interval(float(known.max()), math.nan, math.nan)


_STATISTICS: Mapping[Statistic, Callable[[Floats], Interval]] = {
    "median": median_of_trials,
    "mean": _mean,
    "rms": _rms,
    "max": _largest,
}


def series(results: Results, curve: Curve) -> Band:
    """Return a list column by step, over trials; there is no band for fewer than `FEWEST`."""
    rows = results.rows(curve)
    if curve.metric.startswith("error."):
        found = rmse_curve(rows, curve.metric.removeprefix("error."))
    else:
        found = mean_curve(rows, curve.metric, root=curve.metric == "attack_error")
    nowhere = np.full(found.value.shape, np.nan)
    return found if rows.trials >= FEWEST else Band(found.value, nowhere, nowhere)


def over_what_varies(results: Results, points: Points) -> tuple[Floats, list[Found]]:
    """Return where the points stand, in ascending order, and what is found there."""
    if points.each is not None:
        places = [replace(points, node=name) for name in points.each]
        at = [float(x) for x in points.x or ()]
    else:
        column = f"{SWEPT}{points.setting}"
        table = results.source(points.campaign).read(lambda name: name in ("variant", column))
        values = dict(zip(table["variant"].to_pylist(), table[column].to_pylist(), strict=True))
        fixed = _fixed(results, points, values)
        places = [replace(points, variant=variant) for variant in fixed]
        at = [float(values[variant]) for variant in fixed]
    found = [_found(results, place) for place in places]
    order = np.argsort(at, kind="stable")
    return np.array(at)[order], [found[i] for i in order]


def _fixed(results: Results, points: Points, values: Mapping[int, str]) -> list[int]:
    """Return the variants that differ from the part's own in its setting alone."""
    swept = f"{SWEPT}{points.setting}"
    table = results.source(points.campaign).read(lambda name: name == "variant" or name.startswith(SWEPT))
    others = [name for name in table.column_names if name.startswith(SWEPT) and name != swept]
    settings = {
        variant: tuple(own)
        for variant, *own in zip(
            table["variant"].to_pylist(), *(table[name].to_pylist() for name in others), strict=True
        )
    }
    return [variant for variant in values if settings[variant] == settings[points.variant]]
