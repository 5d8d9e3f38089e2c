"""The verdict in one sentence: what became of a run and of its estimators."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from statistics import median
from typing import NamedTuple

from orchestrator.score.judging import show
from orchestrator.score.measure import expected_estimates
from orchestrator.score.results import NodeScore, Score

_NUMBERED = re.compile(r"(?P<family>.*?)(?P<number>\d+)")

TRACKING_RATIO = 2.0
"""How many times the usual error an attacked estimator may show and still be said to keep tracking."""


def several(count: int, noun: str) -> str:
    """Return how many there are of something."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def _listed(names: Sequence[str], noun: str, most: int = 3) -> str:
    """Return ``a, b and c``, or how many there are when they are too many to name."""
    if len(names) > most:
        return several(len(names), noun)
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def percent(part: float) -> str:
    """Return a share for people."""
    return f"{100 * part:.3g} %"


class Excess(NamedTuple):
    """How many times the usual an estimator's error is, in one state group."""

    node: str
    group: str
    ratio: float


def excess(score: Score) -> Excess | None:
    """Return the attacked estimator whose error is most out of the usual, in the group where it is so.

    The usual is the median RMSE over estimators of the same method that no attacked packet reached, or, where
    there is none, the estimator's own RMSE over its unattacked steps. Groups are compared one by one: in the
    whole state, a group of large numbers would hide another. None when there is nothing to compare.
    """
    found = [
        Excess(node.name, group, compared / usual)
        for node in score.nodes
        if node.attacked_steps
        for group in node.groups
        for usual, compared in [_usual_and_own(node, group, score.nodes)]
        if usual and compared is not None
    ]
    return max(found, key=lambda each: each.ratio, default=None)


def overconfidence(score: Score) -> Excess | None:
    """Return the estimator whose errors most exceed what its covariance says, as a ratio of lengths.

    It is the square root of the mean NEES by its degrees of freedom: about 1 for a consistent estimator. None
    when no estimator gave a covariance.
    """
    found = [
        Excess(node.name, "state", (node.nees.mean / node.nees.dof) ** 0.5)
        for node in score.nodes
        if node.nees.mean is not None and node.nees.dof
    ]
    return max(found, key=lambda each: each.ratio, default=None)


def _usual_and_own(
    node: NodeScore, group: str, nodes: Sequence[NodeScore]
) -> tuple[float | None, float | None]:
    """Return the usual error in a group, and that of one node to compare with it."""
    peers = (
        other.groups[group].rmse
        for other in nodes
        if other.method == node.method and not other.attacked_steps
    )
    spared = [rmse for rmse in peers if rmse is not None]
    own = node.groups[group]
    return (median(spared), own.rmse) if spared else (own.unattacked, own.attacked)


def _subject(score: Score) -> str:
    if len(score.nodes) == 1:
        return f"the estimator {score.nodes[0].name}"
    exchanging = score.exchanging
    if len(score.networks) == 1 and score.networks[0].disagreement is not None and exchanging:
        return "the network"
    there = [node for node in score.nodes if node.silent_from is None] or score.nodes
    other = "other " if len(there) < len(score.nodes) else ""
    if len(there) == 1:
        return f"the {other}estimator {there[0].name}"
    if not exchanging:
        return f"{_estimators([node.name for node in there], other)}, each alone,"
    return f"all {len(there)} {other}estimators"


def _estimators(names: Sequence[str], other: str) -> str:
    """Return ``the estimators e1..e4`` where names are numbered on, else the names, or how many they are."""
    first = _NUMBERED.fullmatch(names[0])
    if len(names) > 2 and first is not None:
        numbers = range(int(first["number"]), int(first["number"]) + len(names))
        if list(names) == [f"{first['family']}{number}" for number in numbers]:
            return f"the {other}estimators {names[0]}..{names[-1]}"
    if len(names) > 3:
        return f"all {len(names)} {other}estimators"
    return f"the {other}estimators {_listed(names, '')}"


def _circumstance(score: Score) -> str:
    links = list(dict.fromkeys(window.link for window in score.windows))
    if not links and any(node.attacked_steps for node in score.nodes):
        return " through the attack on the plant"
    if links:
        return f" through the attack on {_listed(links, 'link')}"
    if score.traffic.lost_share:
        return f" with {percent(score.traffic.lost_share)} of the packets lost"
    return ""


def _divergences(nodes: Iterable[NodeScore]) -> list[str]:
    return [
        f"{node.name} at step {node.divergence_step}" for node in nodes if node.divergence_step is not None
    ]


def _story(score: Score) -> str:
    """Return what became of the estimators, in half a sentence."""
    planned = [
        f"{node.name} from step {node.silent_from}"
        for node in score.nodes
        if node.silent_from is not None and node.name not in score.departed
    ]
    died = [f"{name} in step {step}" for name, step in score.departed.items()]
    fallen = f", while {_listed(planned, '')} fell silent by plan" if planned else ""
    named = _listed(died, "") if len(died) <= 3 else several(len(died), "node")
    lost = f", though the run lost {named}" if died else ""
    return _fate(score) + fallen + lost


def _fate(score: Score) -> str:
    """Return what became of the estimators that were there to the end, or as long as they were."""
    parts = []
    diverged = _divergences(score.nodes)
    if diverged:
        named = f" ({_listed(diverged, '')})" if len(diverged) <= 3 else ""
        parts.append(f"{len(diverged)} of {several(len(score.nodes), 'estimator')} diverged{named}")
    if score.lockouts:
        deaf = [f"{lockout.node} to {lockout.link.partition('->')[0]}" for lockout in score.lockouts]
        named = f" ({_listed(deaf, '')})" if len(deaf) <= 3 else ""
        parts.append(f"{several(len(deaf), 'detector')} locked out for good{named}")
    if parts:
        return " and ".join(parts)
    if all(node.groups["state"].rmse is None for node in score.nodes):
        return "no estimate was scored"
    worst = excess(score)
    if worst is not None and worst.ratio > TRACKING_RATIO:
        where = "" if worst.group == "state" else f" in {worst.group}"
        error = f"but {worst.node} erred {show(round(worst.ratio, 1))} times the usual{where}"
        return f"no estimator diverged{_circumstance(score)}, {error}"
    deluded = overconfidence(score)
    if deluded is not None and deluded.ratio > TRACKING_RATIO:
        error = f"but {deluded.node} erred {show(round(deluded.ratio, 1))} times what it believed"
        return f"no estimator diverged{_circumstance(score)}, {error}"
    return f"{_subject(score)} kept tracking{_circumstance(score)}"


def begun_steps(score: Score) -> int:
    """Return in how many steps some estimator gave its estimate: a node that failed leaves steps in part."""
    return max((node.steps_scored for node in score.nodes), default=0)


def extent(score: Score) -> str:
    """Return how many steps are recorded, and whose estimates are the fewest where some are there in part."""
    begun = begun_steps(score)
    if begun <= score.steps_recorded:
        return f"{score.steps_recorded} of {several(score.steps, 'step')} recorded"
    fewest = min(node.steps_scored for node in score.nodes)
    missed = [node.name for node in score.nodes if node.steps_scored == fewest and node.silent_from is None]
    whose = f" for want of {_listed(missed, 'estimator')}" if missed else ""
    return (
        f"{score.steps_recorded} of {several(score.steps, 'step')} recorded whole "
        f"and {begun - score.steps_recorded} in part{whose}"
    )


def headline(score: Score) -> str:
    """Return the verdict in one sentence.

    It begins with ``PASSED``, ``FAILED``, ``INCOMPLETE``, or ``DONE`` when nothing was expected.
    """
    expected = len(score.expectations)
    failed = [outcome.metric for outcome in score.expectations if not outcome.passed]
    if not score.complete:
        missing = several(
            int(sum(expected_estimates(score, node) - node.steps_scored for node in score.nodes)), "estimate"
        )
        return f"INCOMPLETE: {extent(score)}, {missing} missing; as far as they go, {_story(score)}."
    if failed:
        named = _listed(list(dict.fromkeys(failed)), "metric")
        return (
            f"FAILED: {len(failed)} of {several(expected, 'expectation')} failed ({named}); {_story(score)}."
        )
    if not expected:
        return f"DONE: {_story(score)}; nothing was expected of it."
    held = "the expectation" if expected == 1 else f"all {expected} expectations"
    return f"PASSED: {_story(score)}; {held} held."
