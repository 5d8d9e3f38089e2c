"""What a reader of a comparison must know of those who were compared, and of their samples."""

from __future__ import annotations

from collections.abc import Iterator

from orchestrator.evidence.comparability import different_ground, different_numbers
from orchestrator.evidence.comparison import Comparison
from orchestrator.evidence.contenders import Contender
from orchestrator.evidence.samples import Sample


def warnings(comparison: Comparison) -> list[str]:
    """Return why metrics of the contenders may not be of the same thing."""
    names = [contender.name for contender in comparison.contenders]
    numbers = [len(set(contender.rows.text("node"))) for contender in comparison.contenders]
    documents = [contender.document for contender in comparison.contenders]
    return [*different_ground(names, documents), *different_numbers(names, numbers, comparison.metrics)]


def remarks(comparison: Comparison) -> Iterator[str]:
    """Yield what a reader must know of the contenders and of their samples."""
    for contender in comparison.contenders:
        yield from _remarks_on_rows(contender)
    for metric, samples in zip(comparison.metrics, comparison.samples, strict=True):
        for contender, own in zip(comparison.contenders, samples, strict=True):
            yield from _remarks(contender.name, metric, own)


def _remarks_on_rows(contender: Contender) -> Iterator[str]:
    """Yield what the figures must not be taken for."""
    rows = contender.rows
    for node, attacks in rows.privileged.items():
        yield f"{contender.name}: an oracle tells {node} of {attacks}, which no honest estimator knows"
    if rows.incomplete:
        total, steps = rows.trials, int(contender.document.get("steps", 0))
        record = "its record" if total == 1 else f"the record of {rows.incomplete} of {total} trials"
        there = f" ({steps - rows.most_missing} of {steps} steps)" if total == 1 and steps else ""
        yield f"{contender.name}: {record} is incomplete{there}; figures are those of what is there"


def _remarks(name: str, metric: str, own: Sample) -> Iterator[str]:
    of = f"of {own.values.size + own.undefined} trials"
    if own.failed:
        yield f"{name}: {own.failed} {of} failed; they count as the worst there can be"
    if own.infinite > own.failed:
        yield (
            f"{name}: {metric} is infinite in {own.infinite - own.failed} {of}; these rank behind all others"
        )
    if own.undefined:
        yield f"{name}: {metric} is undefined in {own.undefined} {of}; these are left out"
