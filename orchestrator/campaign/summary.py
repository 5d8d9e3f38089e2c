"""What a campaign came to, in a few figures, each with its interval over trials."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from orchestrator.campaign.figures import RATES, Figure, over_trials, rates_of_packets
from orchestrator.evidence.bootstrap import CONFIDENCE
from orchestrator.evidence.columns import in_usual_order
from orchestrator.evidence.rows import SCORED
from orchestrator.evidence.sources import RESULTS
from orchestrator.evidence.table import settings_by_variant, swept
from orchestrator.score.gather import Floats, Ints

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.parquet as pq

Counts = Mapping[bool, tuple[Floats, Floats]]
"""Of attacked packets (True) and genuine ones how many each row of results has (R,), and rejected."""

_KEYS = ("variant", "trial", "status", "message", "passed")
_ROWS_AT_ONCE = 1024
_NODES_SHOWN = 6
_GROUPS_SHOWN = 3
_FIGURES = (
    *("nees.ratio", "disagreement", "divergences", "detector.recall", "detector.false_alarm_rate"),
    "packets.lost_share",
)


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
    """A whole campaign in figures.

    ``metrics`` are those that have a value somewhere, in their order; ``confidence`` is that of the intervals
    of each variant.
    """

    metrics: tuple[str, ...]
    tallies: tuple[VariantTally, ...]
    lines: tuple[Line, ...]
    confidence: Mapping[int, float]

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
                    "confidence": self.confidence[tally.variant],
                    "estimators": {
                        line.who: {name: figure.facts() for name, figure in line.figures.items()}
                        for line in self.lines
                        if line.variant == tally.variant
                    },
                }
                for tally in self.tallies
            ],
        }


def summarise(directory: Path, confidence: Sequence[float] = ()) -> Summary:
    """Return the figures of a finished campaign.

    ``confidence`` is that of the intervals of each variant, by default 95 % for all.
    """
    import pyarrow.parquet as pq

    file = pq.ParquetFile(directory / RESULTS)
    names = file.schema_arrow.names
    groups = [name.removeprefix("rmse.") for name in names if name.startswith("rmse.")]
    own = in_usual_order(group for group in groups if group != "state")
    shown = own if 0 < len(own) <= _GROUPS_SHOWN else ["state"]
    wanted = [*(f"rmse.{group}" for group in shown), *_FIGURES]
    held = file.read([*_KEYS, "node", "method", "privileged", *wanted, *swept(names)])
    tallies = tuple(_tallies(held))
    levels = {own.variant: confidence[own.variant] if confidence else CONFIDENCE for own in tallies}
    lines = tuple(_lines(held, _packets(file), wanted, levels))
    metrics = tuple(name for name in wanted if any(name in line.figures for line in lines))
    return Summary(metrics, tallies, lines, levels)


def tally(directory: Path) -> tuple[VariantTally, ...]:
    """Return what became of the trials of a finished campaign, by variant; figures are not read."""
    import pyarrow.parquet as pq

    file = pq.ParquetFile(directory / RESULTS)
    return tuple(_tallies(file.read([*_KEYS, *swept(file.schema_arrow.names)])))


def _packets(file: pq.ParquetFile) -> Counts:
    """Return how many packets each row has, and how many of them were rejected, attacked ones or not."""
    parts = []
    for batch in file.iter_batches(_ROWS_AT_ONCE, columns=["packet.attacked", "packet.alarm"]):
        lengths = batch.column("packet.attacked").value_lengths().fill_null(0).to_numpy(zero_copy_only=False)
        row = np.repeat(np.arange(batch.num_rows), lengths)
        attacked, alarm = (
            batch.column(name).flatten().to_numpy(zero_copy_only=False).astype(bool)
            for name in ("packet.attacked", "packet.alarm")
        )
        counted = (attacked, attacked & alarm, ~attacked, ~attacked & alarm)
        parts.append([np.bincount(row[which], minlength=batch.num_rows) for which in counted])
    own = np.concatenate(parts, axis=1).astype(np.float64) if parts else np.zeros((4, 0))
    return {True: (own[0], own[1]), False: (own[2], own[3])}


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


def _lines(
    held: pa.Table, packets: Counts, metrics: Sequence[str], confidence: Mapping[int, float]
) -> Iterator[Line]:
    scored = np.array(held["status"].to_pylist()) == SCORED
    variants, trials = (held[name].to_numpy() for name in ("variant", "trial"))
    who = _who(held.filter(scored))
    values = {name: held[name].to_numpy(zero_copy_only=False) for name in metrics if name not in RATES}
    for variant in np.unique(variants[scored]).tolist():
        here = np.flatnonzero(scored & (variants == variant))
        names, line = np.unique(who[(variants == variant)[scored]], return_inverse=True)
        places = np.unique(trials[here], return_inverse=True)[1]
        rates = _rates(packets, here, line, places, confidence[variant])
        for number in dict.fromkeys(line.tolist()):
            mine = line == number
            found = {
                name: over_trials(name, own[here[mine]], places[mine], places.max() + 1, confidence[variant])
                for name, own in values.items()
            } | {name: own[number] for name, own in rates.items()}
            figures = {name: found[name] for name in metrics}
            known = {name: figure for name, figure in figures.items() if figure is not None}
            yield Line(variant, str(names[number]), known)


def _rates(
    packets: Counts, here: Ints, line: Ints, places: Ints, confidence: float
) -> dict[str, list[Figure | None]]:
    """Return the rates of packets of each line of a variant, whose rows are ``here``, all at once."""

    def by_trial(counts: Floats) -> Floats:
        total = np.zeros((places.max() + 1, line.max() + 1))
        np.add.at(total, (places, line), counts[here])
        return total

    return {
        name: rates_of_packets(by_trial(rejected), by_trial(count), confidence)
        for name, (count, rejected) in ((name, packets[attacked]) for name, attacked in RATES.items())
    }


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
