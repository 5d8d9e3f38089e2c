"""A comparison in words."""

from __future__ import annotations

import math

from orchestrator.evidence.comparison import Compared, Comparison, Verdict, remarks, warnings
from orchestrator.evidence.metrics import Better, meaning_of
from orchestrator.evidence.ranks import Difference

_SIZES = ((0.01, "negligible"), (0.05, "small"), (0.2, "moderate"), (math.inf, "large"))
_SURE = ((0.1, "hardly any"), (0.3, "a weak"), (0.5, "a clear"), (math.inf, "a strong"))


def figure(value: float) -> str:
    """Return a number as people read it."""
    if math.isnan(value):
        return "-"
    if math.isinf(value):
        return "infinite" if value > 0 else "minus infinite"
    return f"{value:.3g}"


def practical_size(relative: float) -> str | None:
    """Return in a word how large a relative difference is in practice; None where there is none."""
    if math.isnan(relative):
        return None
    return next(word for bound, word in _SIZES if abs(relative) < bound or math.isinf(bound))


def tendency(effect: float) -> str:
    """Return in words how consistently one is the larger (Cohen's steps 0.1, 0.3, 0.5)."""
    return next(word for bound, word in _SURE if abs(effect) < bound)


def sentence(own: Compared, comparison: Comparison) -> str:
    """Return the verdict on two contenders in plain language."""
    if own.verdict is Verdict.UNDEFINED:
        sizes = zip((own.first, own.second), own.difference.sizes, strict=True)
        return f"{own.metric} is undefined for {' and '.join(name for name, size in sizes if not size)}."
    metric = own.metric + _infinite(own)
    if own.verdict is Verdict.IDENTICAL:
        return (
            f"{own.first} and {own.second} are identical in {metric}: "
            f"no difference in any of {_trials(own.difference)}."
        )
    if own.verdict is Verdict.TOO_FEW:
        return f"{_few(own, metric)} Seen so far: {_numbers(own, comparison)}.{_finite(own)}"
    head = f"{_head(own, metric)}{_little(own, comparison)}"
    if own.verdict is Verdict.EQUAL:
        head += f" within {comparison.margin:.0%}"
    return f"{head}: {_numbers(own, comparison)}.{_finite(own)} {_practice(own)}"


def _head(own: Compared, metric: str) -> str:
    """Return who is better."""
    first, second = own.first, own.second
    return {
        Verdict.FIRST: f"{first} is better than {second} in {metric}",
        Verdict.SECOND: f"{second} is better than {first} in {metric}",
        Verdict.LOWER: f"{metric} is lower with {first} than with {second}",
        Verdict.HIGHER: f"{metric} is higher with {first} than with {second}",
        Verdict.MIXED: f"Neither {first} nor {second} is called better in {metric}, {_conflict(own)}",
        Verdict.EQUAL: f"{first} and {second} are equal in {metric}",
    }.get(own.verdict, f"No difference between {first} and {second} in {metric} is shown")


def _infinite(own: Compared) -> str:
    """Return in how many trials each is infinite, where any is: no reader may miss it."""
    difference = own.difference
    if not any(difference.infinite):
        return ""
    whose = zip((own.first, own.second), difference.infinite, difference.sizes, strict=True)
    return f" (infinite {' and '.join(f'in {count} of {n} trials with {name}' for name, count, n in whose)})"


def _conflict(own: Compared) -> str:
    """Return what speaks for whom where infinite and finite trials do not favour the same."""
    shares = [n / of for n, of in zip(own.difference.infinite_alone, own.difference.sizes, strict=True)]
    calm, other = (own.first, own.second) if shares[0] < shares[1] else (own.second, own.first)
    return f"since {calm} is infinite less often, but {other} is better otherwise"


def _finite(own: Compared) -> str:
    """Return how those trials fell that are finite with both, where some are not."""
    finite = own.difference.finite
    if finite is None or not min(finite.sizes):
        return ""
    shift = f"median difference {figure(finite.shift.value)}"
    if not finite.paired:
        return f" Of the finite values: {shift}, {finite.effect_name} {finite.effect:+.2f}."
    return f" Where both are finite: {shift}, {_outcomes(own, finite)}."


def _little(own: Compared, comparison: Comparison) -> str:
    """Return the warning of a sure difference that is too small to matter."""
    is_sure = own.verdict in (Verdict.FIRST, Verdict.SECOND, Verdict.LOWER, Verdict.HIGHER)
    return f", but by no more than {comparison.margin:.0%}" if is_sure and own.within_margin else ""


def _few(own: Compared, metric: str) -> str:
    unit = "common trials" if own.difference.paired else "trials of each"
    return (
        f"Too few trials to tell {own.first} from {own.second} in {metric}: "
        f"with {_trials(own.difference)} no difference can be significant; "
        f"give at least {own.trials_needed} {unit}."
    )


def _trials(difference: Difference) -> str:
    first, second = difference.sizes
    if difference.paired:
        return f"{first} common {'trial' if first == 1 else 'trials'}"
    return f"{first} and {second} trials, unpaired, since fewer than two have seed and trial in common"


def _numbers(own: Compared, comparison: Comparison) -> str:
    difference = own.difference
    much = _shift(own, comparison) if difference.is_shift else _means(own, comparison)
    return (
        f"{much}, p {_p(own.p_adjusted)}, {difference.effect_name} {difference.effect:+.2f}, "
        f"{_outcomes(own, difference)}"
    )


def _shift(own: Compared, comparison: Comparison) -> str:
    """Return the difference as a shift with its interval."""
    difference, shift = own.difference, own.difference.shift
    unit = " in |log ratio|" if meaning_of(own.metric).better is Better.ONE else ""
    relative = f", {own.relative:+.1%} of their mean" if math.isfinite(own.relative) else ""
    interval = f"{comparison.confidence:.0%} interval {figure(shift.low)} to {figure(shift.high)}"
    level = 1.0 - comparison.confidence
    if difference.least_p > level:
        interval = f"no {comparison.confidence:.0%} interval from so few trials"
    elif difference.p_value <= level and 0.0 in (shift.low, shift.high):
        interval += " without 0 itself"
    return f"median difference {figure(shift.value)}{unit} ({interval}{relative})"


def _means(own: Compared, comparison: Comparison) -> str:
    """Return means, and in which share of the trials that differ the first is lower, where most are tied."""
    difference, (first, second) = own.difference, own.difference.means
    unit = " of |log ratio|" if meaning_of(own.metric).better is Better.ONE else ""
    told = f"mean{unit} {figure(first)} and {figure(second)}"
    smaller = difference.smaller
    if smaller is None:
        return told
    lower, _ = _sides(own)
    differing = sum(difference.counts or ()) - (difference.counts or (0, 0, 0))[1]
    interval = f"{comparison.confidence:.0%} interval {smaller.low:.0%} to {smaller.high:.0%}"
    return (
        f"{told}; they differ in {differing} of {difference.sizes[0]} trials, of which {own.first} is "
        f"{lower} in {smaller.value:.0%} ({interval})"
    )


def _sides(own: Compared) -> tuple[str, str]:
    is_ratio = meaning_of(own.metric).better is Better.ONE
    return ("nearer to 1", "farther from 1") if is_ratio else ("lower", "higher")


def _outcomes(own: Compared, difference: Difference) -> str:
    """Return how the trials fell."""
    counts = difference.counts
    if counts is None or not difference.sizes[0]:
        return _trials(difference)
    less, same, more = counts
    lower, higher = _sides(own)
    ties = f", as large in {same}" if same else ""
    return f"{own.first} {lower} in {less}{ties} and {higher} in {more} of {_trials(difference)}"


def _p(p_value: float) -> str:
    return "< 0.0001" if p_value < 1e-4 else f"= {p_value:.2g}"


def _practice(own: Compared) -> str:
    """Return what the numbers mean in practice."""
    difference, is_undecided = own.difference, own.verdict is Verdict.UNDECIDED
    if own.verdict is Verdict.EQUAL:
        return "The whole interval is too small to matter."
    if own.verdict is Verdict.MIXED:
        return "Which one is better depends on what an infinite value costs."
    if any(difference.infinite_alone):
        alone = "one is infinite where the other is not"
        why = f"since {alone if difference.paired else 'some values are infinite'}"
        if is_undecided:
            return f"Nor can they be called equal, {why}."
        size = f"not to be told by a median, {why}"
    elif is_undecided:
        cure = ": more trials would narrow the interval" if difference.is_shift else ""
        return f"Nor are they shown to be equal{cure}."
    elif not difference.is_shift:
        size = "not to be told by a median, since none describes it"
    else:
        size = practical_size(own.relative) or "not to be told relative to the medians"
    return f"In practice the difference is {size}, with {tendency(difference.effect)} tendency over trials."


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
