"""Expectations: what a topology promises of its run, held against the score."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence

from orchestrator.score.catalogue import Metric, find_metric, metric_names
from orchestrator.score.expectation import Expectation
from orchestrator.score.gather import ScoreError
from orchestrator.score.measure import Value, measure
from orchestrator.score.results import Outcome, Score

_WORDS = {"<=": "at most", ">=": "at least", "==": "exactly"}


def _worst(values: Sequence[Value], relation: str, bound: float) -> Value:
    """Return the value that is hardest on the expectation; the first of equals."""
    badness: dict[str, Callable[[Value], float]] = {
        "<=": lambda value: value[1],
        ">=": lambda value: -value[1],
        "==": lambda value: abs(value[1] - bound),
    }
    return max(values, key=badness[relation])


def _holds(measured: float, relation: str, bound: float) -> bool:
    return {"<=": measured <= bound, ">=": measured >= bound, "==": measured == bound}[relation]


def show(value: float) -> str:
    """Return a number for people: four significant digits, counts in full."""
    if math.isinf(value):
        return "without bound"
    return f"{value:.0f}" if value == round(value) and abs(value) < 1e15 else f"{value:.4g}"


def _outcome(
    expected: Expectation, metric: Metric, values: Sequence[Value], relation: str, bound: float
) -> Outcome:
    claim = f"{expected.metric} {_WORDS[relation]} {show(bound)}"
    selected = bool(expected.nodes or expected.links)
    known = [value for value in values if not math.isnan(value[1])]
    unknown = [value for value in values if math.isnan(value[1])]
    if not known or (selected and unknown):
        where = unknown[0][0] if unknown else "nothing"
        measured, passed = math.nan, False
        message = f"{claim}: undefined for {where}, {metric.undefined}"
    else:
        where, measured = _worst(known, relation, bound)
        passed = _holds(measured, relation, bound)
        message = f"{claim}: {show(measured)} ({where}{f', worst of {len(known)}' if len(known) > 1 else ''})"
    return Outcome(
        metric=expected.metric,
        nodes=list(expected.nodes),
        links=list(expected.links),
        relation=relation,
        bound=bound,
        measured=measured if math.isfinite(measured) else None,
        where=where,
        passed=passed,
        message=message,
        line=expected.line,
    )


def judge_expectations(
    score: Score, expectations: Sequence[Expectation], groups: Collection[str]
) -> list[Outcome]:
    """Return the outcomes in the order of the expectations, one for each bound.

    Raises `ScoreError` for a metric that the catalogue does not have.
    """
    outcomes = []
    for expected in expectations:
        metric = find_metric(expected.metric, groups)
        if metric is None:
            raise ScoreError(
                f"there is no metric '{expected.metric}'; there are {', '.join(metric_names(groups))}"
            )
        values = measure(score, expected.metric, metric, expected.nodes, expected.links)
        bounds = {"<=": expected.at_most, ">=": expected.at_least, "==": expected.equals}
        outcomes += [
            _outcome(expected, metric, values, relation, bound)
            for relation, bound in bounds.items()
            if bound is not None
        ]
    return outcomes
