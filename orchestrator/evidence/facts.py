"""A comparison as plain data for programs."""

from __future__ import annotations

import math
from typing import Any

from orchestrator.evidence.comparison import Compared, Comparison, remarks, warnings
from orchestrator.evidence.intervals import Interval
from orchestrator.evidence.metrics import label
from orchestrator.evidence.ranks import Difference
from orchestrator.evidence.samples import Sample
from orchestrator.evidence.wording import practical_size, sentence

FORMAT = 1


def facts(comparison: Comparison) -> dict[str, Any]:
    """Return a comparison as plain data; infinite numbers are the texts ``inf`` and ``-inf``."""
    return {
        "format": FORMAT,
        "confidence": comparison.confidence,
        "margin": comparison.margin,
        "correction": "holm",
        "contenders": [{"name": own.name, "path": own.path} for own in comparison.contenders],
        "samples": [
            {"metric": metric, "of": label(metric), "contender": contender.name, **_sample(own)}
            for metric, samples in zip(comparison.metrics, comparison.samples, strict=True)
            for contender, own in zip(comparison.contenders, samples, strict=True)
        ],
        "comparisons": [
            {**_compared(own), "sentence": sentence(own, comparison)} for own in comparison.compared
        ],
        "warnings": warnings(comparison),
        "remarks": list(dict.fromkeys(remarks(comparison))),
    }


def _sample(own: Sample) -> dict[str, Any]:
    return {
        "trials": int(own.values.size),
        "failed": own.failed,
        "undefined": own.undefined,
        "infinite": own.infinite,
        "median": _number(own.median),
    }


def _compared(own: Compared) -> dict[str, Any]:
    difference, finite = own.difference, own.difference.finite
    return {
        "metric": own.metric,
        "of": label(own.metric),
        "first": own.first,
        "second": own.second,
        "verdict": own.verdict.value,
        "within_margin": own.within_margin,
        "paired": difference.paired,
        "trials": list(difference.sizes),
        "infinite": list(difference.infinite),
        "infinite_alone": list(difference.infinite_alone),
        "difference": _number(difference.shift.value),
        "low": _number(difference.shift.low),
        "high": _number(difference.shift.high),
        "is_shift": difference.is_shift,
        "relative": _number(own.relative),
        "practical_size": practical_size(own.relative),
        "means": [_number(mean) for mean in difference.means],
        "test": "Wilcoxon signed-rank" if difference.paired else "Mann-Whitney",
        "p": difference.p_value,
        "p_adjusted": own.p_adjusted,
        "effect_name": difference.effect_name,
        "effect": difference.effect,
        "lower_equal_higher": _counts(difference),
        "lower_share": _interval(difference.smaller),
        "finite": None if finite is None else _finite_facts(finite),
        "trials_needed": own.trials_needed,
    }


def _finite_facts(finite: Difference) -> dict[str, Any]:
    return {
        "trials": list(finite.sizes),
        "difference": _number(finite.shift.value),
        "p": finite.p_value,
        "effect": finite.effect,
        "lower_equal_higher": _counts(finite),
    }


def _counts(difference: Difference) -> list[int] | None:
    return None if difference.counts is None else list(difference.counts)


def _interval(interval: Interval | None) -> list[float | str | None] | None:
    return None if interval is None else [_number(x) for x in (interval.value, interval.low, interval.high)]


def _number(value: float) -> float | str | None:
    if math.isnan(value):
        return None
    return value if math.isfinite(value) else ("inf" if value > 0 else "-inf")
