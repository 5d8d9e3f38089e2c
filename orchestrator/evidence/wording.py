"""A comparison in words, and as plain data for programs."""

from __future__ import annotations

import math
from typing import Any

from orchestrator.evidence.comparison import Compared, Comparison, Verdict, remarks, warnings
from orchestrator.evidence.metrics import Better, meaning_of
from orchestrator.evidence.ranks import Difference
from orchestrator.evidence.samples import Sample

FORMAT = 1
_SIZES = ((0.01, "negligible"), (0.05, "small"), (0.2, "moderate"), (math.inf, "large"))
_SURE = ((0.1, "hardly any"), (0.3, "a weak"), (0.5, "a clear"), (math.inf, "a strong"))


def figure(value: float) -> str:
    """Return a number as people read it."""
    if math.isnan(value):
        return "-"
    if math.isinf(value):
        return "infinite" if value > 0 else "minus infinite"
    return f"{value:.3g}"


def practical_size(relative: float) -> str:
    """Return in a word how large a relative difference is in practice."""
    if math.isnan(relative):
        return "not to be told relative to the medians"
    return next(word for bound, word in _SIZES if abs(relative) < bound or math.isinf(bound))


def tendency(effect: float) -> str:
    """Return in words how consistently one is the larger (Cohen's steps 0.1, 0.3, 0.5)."""
    return next(word for bound, word in _SURE if abs(effect) < bound)


def sentence(own: Compared, comparison: Comparison) -> str:
    """Return the verdict on two contenders in plain language."""
    names = {Verdict.FIRST: (own.first, own.second), Verdict.SECOND: (own.second, own.first)}
    if own.verdict in names:
        winner, loser = names[own.verdict]
        head = f"{winner} is better than {loser} in {own.metric}{_little(own, comparison)}"
    elif own.verdict in (Verdict.LOWER, Verdict.HIGHER):
        word = "lower" if own.verdict is Verdict.LOWER else "higher"
        head = f"{own.metric} is {word} with {own.first} than with {own.second}{_little(own, comparison)}"
    elif own.verdict is Verdict.IDENTICAL:
        return (
            f"{own.first} and {own.second} are identical in {own.metric}: "
            f"no difference in any of {_trials(own.difference)}."
        )
    elif own.verdict is Verdict.EQUAL:
        head = f"{own.first} and {own.second} are equal in {own.metric} within {comparison.margin:.0%}"
    elif own.verdict is Verdict.UNDEFINED:
        sizes = zip((own.first, own.second), own.difference.sizes, strict=True)
        return f"{own.metric} is undefined for {' and '.join(name for name, size in sizes if not size)}."
    elif own.verdict is Verdict.TOO_FEW:
        return f"{_few(own)} Seen so far: {_numbers(own, comparison)}."
    else:
        head = f"No difference between {own.first} and {own.second} in {own.metric} is shown"
    return f"{head}: {_numbers(own, comparison)}. {_practice(own)}"


def _little(own: Compared, comparison: Comparison) -> str:
    """Return the warning of a sure difference that is too small to matter."""
    return f", but by no more than {comparison.margin:.0%}" if own.within_margin else ""


def _few(own: Compared) -> str:
    unit = "common trials" if own.difference.paired else "trials of each"
    return (
        f"Too few trials to tell {own.first} from {own.second} in {own.metric}: "
        f"with {_trials(own.difference)} no difference can be significant; "
        f"give at least {own.trials_needed} {unit}."
    )


def _trials(difference: Difference) -> str:
    first, second = difference.sizes
    if difference.paired:
        return f"{first} common {'trial' if first == 1 else 'trials'}"
    return f"{first} and {second} trials, unpaired, since fewer than two have seed and trial in common"


def _numbers(own: Compared, comparison: Comparison) -> str:
    shift = own.difference.shift
    unit = " in |log ratio|" if meaning_of(own.metric).better is Better.ONE else ""
    relative = f", {own.relative:+.1%} of their mean" if math.isfinite(own.relative) else ""
    interval = f"{comparison.confidence:.0%} interval {figure(shift.low)} to {figure(shift.high)}"
    if own.difference.least_p > 1.0 - comparison.confidence:
        interval = f"no {comparison.confidence:.0%} interval from so few trials"
    return (
        f"median difference {figure(shift.value)}{unit} ({interval}{relative}), p {_p(own.p_adjusted)}, "
        f"{own.difference.effect_name} {own.difference.effect:+.2f}, {_outcomes(own)}"
    )


def _outcomes(own: Compared) -> str:
    """Return how the trials fell."""
    counts = own.difference.counts
    if counts is None or not own.difference.sizes[0]:
        return _trials(own.difference)
    less, same, more = counts
    ties = f", as large in {same}" if same else ""
    return f"{own.first} lower in {less}{ties} and higher in {more} of {_trials(own.difference)}"


def _p(p_value: float) -> str:
    return "< 0.0001" if p_value < 1e-4 else f"= {p_value:.2g}"


def _practice(own: Compared) -> str:
    """Return what the numbers mean in practice."""
    if own.verdict is Verdict.EQUAL:
        return "The whole interval is too small to matter."
    if own.verdict is Verdict.UNDECIDED:
        return "Nor are they shown to be equal: more trials would narrow the interval."
    size = practical_size(own.relative)
    how = f"{tendency(own.difference.effect)} tendency over trials"
    return f"In practice the difference is {size}, with {how}."


def lines(comparison: Comparison) -> list[str]:
    """Return all warnings, verdicts and remarks."""
    number = sum(own.verdict is not Verdict.UNDEFINED for own in comparison.compared)
    told = [f"Warning: {warning}." for warning in warnings(comparison)]
    told += [sentence(own, comparison) for own in comparison.compared]
    if number > 1:
        told.append(
            f"p values are adjusted together for {number} comparisons (Holm); each interval is for itself."
        )
    return told + [f"Note: {remark}." for remark in dict.fromkeys(remarks(comparison))]


def facts(comparison: Comparison) -> dict[str, Any]:
    """Return a comparison as plain data; infinite numbers are the texts ``inf`` and ``-inf``."""
    return {
        "format": FORMAT,
        "confidence": comparison.confidence,
        "margin": comparison.margin,
        "correction": "holm",
        "contenders": [{"name": own.name, "path": own.path} for own in comparison.contenders],
        "samples": [
            {"metric": metric, "contender": contender.name, **_sample(own)}
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
    difference = own.difference
    return {
        "metric": own.metric,
        "first": own.first,
        "second": own.second,
        "verdict": own.verdict.value,
        "paired": difference.paired,
        "trials": list(difference.sizes),
        "difference": _number(difference.shift.value),
        "low": _number(difference.shift.low),
        "high": _number(difference.shift.high),
        "relative": _number(own.relative),
        "practical_size": practical_size(own.relative) if math.isfinite(own.relative) else None,
        "test": "Wilcoxon signed-rank" if difference.paired else "Mann-Whitney",
        "p": difference.p_value,
        "p_adjusted": own.p_adjusted,
        "effect_name": difference.effect_name,
        "effect": difference.effect,
        "lower_equal_higher": None if difference.counts is None else list(difference.counts),
        "trials_needed": own.trials_needed,
    }


def _number(value: float) -> float | str | None:
    if math.isnan(value):
        return None
    return value if math.isfinite(value) else ("inf" if value > 0 else "-inf")
