"""Whether A is better than B, by how much, and how sure that is.

Every two contenders are compared in every metric, trial by trial where they share seeds and trials. All
p values of one comparison are adjusted together (Holm 1979), so that among equals a false difference turns up
anywhere with at most the level 1 - confidence. Intervals are those of each difference alone. A contender for
which a metric has no value takes no part in it.

No median sees a minority of infinite values. Where one is infinite alone, nobody is called equal, nor a
difference small; and who is infinite more often is not called better for being so otherwise.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from orchestrator.evidence.bootstrap import CONFIDENCE
from orchestrator.evidence.comparability import different_ground, different_numbers
from orchestrator.evidence.contenders import Contender
from orchestrator.evidence.metrics import Better, meaning_of
from orchestrator.evidence.ranks import (
    Difference,
    holm,
    least_p,
    pair,
    paired_difference,
    unpaired_difference,
)
from orchestrator.evidence.samples import Sample, sample

MARGIN = 0.05
"""Relative differences below this are called too small to matter, unless told otherwise."""


class Verdict(Enum):
    """What a comparison came to."""

    FIRST = "first is better"
    SECOND = "second is better"
    LOWER = "first is lower"
    HIGHER = "first is higher"
    MIXED = "mixed"
    IDENTICAL = "identical"
    EQUAL = "equal"
    UNDECIDED = "no difference shown"
    TOO_FEW = "too few trials"
    UNDEFINED = "undefined"


@dataclass(frozen=True)
class Compared:
    """Two contenders in one metric.

    Parameters
    ----------
    metric, first, second
        What was compared; differences are first less second.
    difference
        Their difference with its interval, p value and effect size.
    p_adjusted
        The p value after Holm's correction over all comparisons made together.
    relative
        The difference over the mean of the two medians; NaN where these are not positive and finite, and
        where it tells nothing: one is infinite alone, or no shift describes how they differ.
    trials_needed
        How many pairs (or trials of each) could come to a verdict at all; None where there are enough.
    verdict
        What follows.
    within_margin
        Whether the whole interval is within the margin, so that a difference is too small to matter. Never
        where `relative` has no meaning.
    """

    metric: str
    first: str
    second: str
    difference: Difference
    p_adjusted: float
    relative: float
    trials_needed: int | None
    verdict: Verdict
    within_margin: bool


@dataclass(frozen=True)
class Comparison:
    """A whole comparison: the samples by metric and contender, and every two of them."""

    contenders: Sequence[Contender]
    metrics: Sequence[str]
    confidence: float
    margin: float
    samples: Sequence[Sequence[Sample]]
    compared: Sequence[Compared]


def compare(
    contenders: Sequence[Contender],
    metrics: Sequence[str],
    confidence: float = CONFIDENCE,
    margin: float = MARGIN,
) -> Comparison:
    """Return every comparison of two contenders in each metric, in the order in which they are given.

    Parameters
    ----------
    contenders, metrics
        Who, and in what.
    confidence
        Of the intervals; its complement is the level of the verdicts.
    margin
        Relative difference up to which two are called equal, when the whole interval is within it and neither
        is infinite alone in any pair.
    """
    samples = [[sample(contender.rows, metric) for contender in contenders] for metric in metrics]
    pairs = [
        (metric, i, j, _difference(of[i], of[j], confidence))
        for metric, of in zip(metrics, samples, strict=True)
        for i, j in itertools.combinations(range(len(contenders)), 2)
    ]
    judged = [difference.p_value for *_, difference in pairs if min(difference.sizes)]
    adjusted = iter(holm(judged))
    of_metric = dict(zip(metrics, samples, strict=True))
    compared = [
        _compared(
            (metric, contenders[i].name, contenders[j].name),
            (of_metric[metric][i].median, of_metric[metric][j].median),
            difference,
            (next(adjusted) if min(difference.sizes) else 1.0, len(judged)),
            (confidence, margin),
        )
        for metric, i, j, difference in pairs
    ]
    return Comparison(contenders, metrics, confidence, margin, samples, compared)


def _difference(first: Sample, second: Sample, confidence: float) -> Difference:
    """Return the difference of two samples: paired where they have at least two trials in common."""
    at_first, at_second = pair(first.keys, second.keys)
    if at_first.size > 1 or (at_first.size == min(len(first.keys), len(second.keys)) == 1):
        return paired_difference(first.values[at_first], second.values[at_second], confidence)
    return unpaired_difference(first.values, second.values, confidence)


def _compared(
    names: tuple[str, str, str],
    medians: tuple[float, float],
    difference: Difference,
    family: tuple[float, int],
    settings: tuple[float, float],
) -> Compared:
    metric, first, second = names
    (p, number), (confidence, margin) = family, settings
    level = 1.0 - confidence
    with np.errstate(invalid="ignore"):
        scale = 0.5 * (medians[0] + medians[1])
    is_measured = difference.is_shift and not any(difference.infinite_alone)
    scale = scale if is_measured and np.isfinite(scale) and scale > 0.0 else np.nan
    relative, reach = difference.shift.value / scale, scale * margin
    within = -reach <= difference.shift.low and difference.shift.high <= reach
    needed, verdict = None, Verdict.UNDEFINED
    if min(difference.sizes):
        needed = _needed(difference, level / number)
        verdict = _verdict(meaning_of(metric).better, difference, p <= level, level / number)
        if verdict is Verdict.UNDECIDED and needed is not None:
            verdict = Verdict.TOO_FEW
        elif verdict is Verdict.UNDECIDED and within:
            verdict = Verdict.EQUAL
    return Compared(metric, first, second, difference, p, relative, needed, verdict, within)


def _needed(difference: Difference, level: float) -> int | None:
    """Return how many trials could give a p value within a level, None when there are enough."""
    if difference.least_p <= level:
        return None
    return next(n for n in itertools.count(1) if least_p(difference.paired, n, n) <= level)


def _verdict(better: Better, difference: Difference, is_significant: bool, level: float) -> Verdict:
    """Return who is better, mixed, or that no difference is shown.

    ``level`` is that of the test of the finite values alone.
    """
    if difference.identical:
        return Verdict.IDENTICAL
    if better is Better.NEITHER:
        shown = Verdict.LOWER if difference.statistic < 0.0 else Verdict.HIGHER
        return shown if is_significant else Verdict.UNDECIDED
    winner = _favoured(better, difference)
    less_infinite = _less_infinite(difference)
    if is_significant:
        return winner if less_infinite in (None, winner) else Verdict.MIXED
    finite = difference.finite
    if less_infinite is None or finite is None or finite.p_value > level:
        return Verdict.UNDECIDED
    return Verdict.UNDECIDED if _favoured(better, finite) is less_infinite else Verdict.MIXED


def _favoured(better: Better, difference: Difference) -> Verdict:
    """Return whom the ranks favour."""
    return Verdict.FIRST if (difference.statistic < 0.0) != (better is Better.MORE) else Verdict.SECOND


def _less_infinite(difference: Difference) -> Verdict | None:
    """Return who is infinite alone in the smaller share of trials, None where neither is."""
    first, second = (alone / n for alone, n in zip(difference.infinite_alone, difference.sizes, strict=True))
    if first == second:
        return None
    return Verdict.FIRST if first < second else Verdict.SECOND


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
