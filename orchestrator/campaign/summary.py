"""What a campaign came to, in a few figures: medians over trials, each with an interval."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from orchestrator.evidence.bootstrap import CONFIDENCE
from orchestrator.evidence.columns import in_usual_order
from orchestrator.evidence.rows import SCORED
from orchestrator.evidence.samples import together
from orchestrator.evidence.sources import RESULTS
from orchestrator.evidence.table import settings_by_variant, swept

if TYPE_CHECKING:
    import pyarrow as pa

_NODES_SHOWN = 6
_GROUPS_SHOWN = 3
_FIGURES = (
    *("nees.ratio", "disagreement", "divergences", "detector.recall", "detector.false_alarm_rate"),
    "packets.lost_share",
)


@dataclass(frozen=True)
class Figure:
    """A median over ``samples`` trials, and the bounds of its confidence interval.

    The interval needs no distribution: its ends are order statistics (binomial quantiles). It is None where
    there are too few trials for `CONFIDENCE`.
    """

    median: float
    low: float | None
    high: float | None
    samples: int

    def facts(self) -> dict[str, float | int | str | None]:
        """Return the figure for JSON, which has no infinity."""
        values = {"median": self.median, "low": self.low, "high": self.high}
        shown = {
            name: "unbounded" if value is not None and np.isinf(value) else value
            for name, value in values.items()
        }
        return {**shown, "trials": self.samples}


@dataclass(frozen=True)
class Line:
    """One line: a variant, and in it an estimator or all of one method, together as in a comparison."""

    variant: int
    who: str
    figures: dict[str, Figure]


@dataclass(frozen=True)
class VariantTally:
    """What became of a variant's trials; ``failed_trials`` are the numbers of those that failed."""

    variant: int
    settings: dict[str, str]
    trials: int
    failed: int
    passed: int
    messages: tuple[str, ...]
    failed_trials: tuple[int, ...]


@dataclass(frozen=True)
class Summary:
    """A whole campaign in figures; ``metrics`` are those that have a value somewhere, in their order."""

    metrics: tuple[str, ...]
    tallies: tuple[VariantTally, ...]
    lines: tuple[Line, ...]

    @property
    def failed(self) -> int:
        """The number of trials that failed."""
        return sum(tally.failed for tally in self.tallies)

    def facts(self) -> dict[str, Any]:
        """Return the whole as plain data, ready for JSON."""
        return {
            "trials": sum(tally.trials for tally in self.tallies),
            "failed": self.failed,
            "variants": [
                {
                    "variant": tally.variant,
                    "set": tally.settings,
                    "trials": tally.trials,
                    "failed": tally.failed,
                    "failed_trials": tally.failed_trials,
                    "passed": tally.passed,
                    "messages": tally.messages,
                    "estimators": {
                        line.who: {name: figure.facts() for name, figure in line.figures.items()}
                        for line in self.lines
                        if line.variant == tally.variant
                    },
                }
                for tally in self.tallies
            ],
        }


def median_interval(values: NDArray[np.float64], confidence: float = CONFIDENCE) -> Figure:
    """Return the median of independent values (T,), T > 0, with its distribution-free interval.

    The interval lies between the order statistics ``k`` and ``T + 1 - k`` with the largest ``k`` whose
    coverage, that of a binomial of ``T`` fair draws, is at least ``confidence``.
    """
    from scipy.special import bdtr  # late: the import takes longer than the rest

    ordered = np.sort(values)
    size = ordered.size
    below = np.arange(size // 2)
    allowed = np.flatnonzero(2.0 * bdtr(below, size, 0.5) <= 1.0 - confidence)
    with np.errstate(invalid="ignore"):
        median = float(np.median(ordered))
    if not allowed.size:
        return Figure(median, None, None, size)
    k = int(allowed[-1])
    return Figure(median, float(ordered[k]), float(ordered[size - 1 - k]), size)


def summarise(directory: Path) -> Summary:
    """Return the figures of a finished campaign."""
    import pyarrow.parquet as pq

    file = pq.ParquetFile(directory / RESULTS)
    names = file.schema_arrow.names
    groups = [name.removeprefix("rmse.") for name in names if name.startswith("rmse.")]
    own = in_usual_order(group for group in groups if group != "state")
    shown = own if 0 < len(own) <= _GROUPS_SHOWN else ["state"]
    wanted = [*(f"rmse.{group}" for group in shown), *_FIGURES]
    keys = ["variant", "trial", "node", "method", "privileged", "status", "message", "passed"]
    held = file.read([*keys, *wanted, *swept(names)])
    lines = tuple(_lines(held, wanted))
    metrics = tuple(name for name in wanted if any(name in line.figures for line in lines))
    return Summary(metrics, tuple(_tallies(held)), lines)


def _tallies(held: pa.Table) -> Iterator[VariantTally]:
    columns = {name: held[name].to_pylist() for name in ("variant", "trial", "status", "message", "passed")}
    settings = settings_by_variant(held)
    trials: dict[int, dict[int, int]] = {}
    for row, (variant, trial) in enumerate(zip(columns["variant"], columns["trial"], strict=True)):
        trials.setdefault(variant, {}).setdefault(trial, row)
    for variant, first_rows in trials.items():
        rows = list(first_rows.values())
        failed = [row for row in rows if columns["status"][row] != SCORED]
        yield VariantTally(
            variant,
            settings[variant],
            len(rows),
            len(failed),
            sum(bool(columns["passed"][row]) for row in rows),
            tuple(dict.fromkeys(columns["message"][row] for row in failed)),
            tuple(columns["trial"][row] for row in failed),
        )


def _lines(held: pa.Table, metrics: Sequence[str]) -> Iterator[Line]:
    import pyarrow.compute as pc

    held = held.filter(pc.equal(held["status"], SCORED))
    variants, trials = (held[name].to_numpy() for name in ("variant", "trial"))
    who = _who(held)
    values = {name: held[name].to_numpy(zero_copy_only=False) for name in metrics}
    for variant in np.unique(variants):
        here = variants == variant
        for name in dict.fromkeys(who[here].tolist()):
            mine = here & (who == name)
            places = np.unique(trials[mine], return_inverse=True)[1]
            found = {
                metric: together(metric, values[metric][mine], places, places.max() + 1) for metric in metrics
            }
            known = {metric: own[~np.isnan(own)] for metric, own in found.items()}
            figures = {metric: median_interval(own) for metric, own in known.items() if own.size}
            yield Line(int(variant), name, figures)


def _who(held: pa.Table) -> NDArray[np.str_]:
    """Return what each row counts for: its node when there are few, else its method.

    Those that an oracle tells of attacks are marked, and apart from the others of their method.
    """
    nodes, methods = (np.array(held[name].to_pylist(), dtype=str) for name in ("node", "method"))
    is_privileged = np.array([bool(told) for told in held["privileged"].to_pylist()], dtype=bool)
    methods = np.where(is_privileged, np.char.add(methods, " PRIVILEGED"), methods)
    if np.unique(nodes).size <= _NODES_SHOWN:
        return np.char.add(np.char.add(nodes, " "), methods)
    sizes = {method: np.unique(nodes[methods == method]).size for method in np.unique(methods).tolist()}
    return np.array([f"{method} ({sizes[method]})" for method in methods.tolist()], dtype=str)
