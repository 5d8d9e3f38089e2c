"""The value of any metric of the catalogue, read from a score."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property
from operator import attrgetter
from statistics import fmean

from orchestrator.score.catalogue import Metric
from orchestrator.score.link_results import AttackWindow, Confusion, LinkScore, SenderScore, Traffic
from orchestrator.score.results import AttackScore, Consistency, NodeScore, Score

Value = tuple[str, float]
"""What a value belongs to, and the value: NaN where undefined, infinite where unbounded."""


@dataclass(frozen=True)
class LinkSet:
    """Some links and all that happened on them; ``where`` names the set."""

    where: str
    links: Sequence[LinkScore]
    score: Score

    @cached_property
    def names(self) -> set[str]:
        """The links' names."""
        return {link.name for link in self.links}

    @cached_property
    def windows(self) -> list[AttackWindow]:
        """The attack windows on links that a detector judged."""
        names = self.names
        return [window for window in self.score.windows if window.judged and window.link in names]

    @cached_property
    def traffic(self) -> Traffic:
        """Their traffic, pooled."""
        parts = [link.traffic for link in self.links]
        return Traffic.of(**{count: sum(map(attrgetter(count), parts)) for count in Traffic.COUNTS})

    @cached_property
    def confusion(self) -> Confusion | None:
        """The confusion over the judged ones among them; None when none is judged."""
        return pooled_confusion(self.links)


def _or_nan(value: float | None) -> float:
    return math.nan if value is None else float(value)


def _group_error(node: NodeScore, family: str, group: str) -> float:
    if node.divergence_step is not None:
        return math.inf
    figures = node.groups[group]
    return _or_nan(
        getattr(figures, {"rmse_attacked": "attacked", "rmse_unattacked": "unattacked"}.get(family, family))
    )


def _consistency(node: NodeScore, figures: Consistency, name: str) -> float:
    if figures.mean is None or figures.dof is None or name == "inside":
        return _or_nan(figures.inside)
    if node.divergence_step is not None:
        return math.inf
    return figures.mean if name == "mean" else figures.mean / figures.dof


def _attack(node: NodeScore, name: str) -> float:
    """Return a figure on signal attacks; of delays, the longest."""
    figures = node.attack
    if figures is None:
        return math.nan
    if name.endswith("_delay"):
        return _longest(figures, name)
    if name == "rmse" and node.divergence_step is not None:
        return math.inf
    return _or_nan(getattr(figures, name))


def _longest(figures: AttackScore, name: str) -> float:
    """Return the longest delay over the windows; endless when one was missed, though it was spoken of."""
    spoken_of = "statements" if name == "detection_delay" else "statements_after"
    delays = [getattr(window, name) for window in figures.windows if getattr(window, spoken_of)]
    return max((math.inf if delay is None else float(delay) for delay in delays), default=math.nan)


def expected_estimates(score: Score, node: NodeScore) -> int:
    """Return the number of estimates that a node owes: one a step, until it falls silent by plan."""
    return score.steps if node.silent_from is None else node.silent_from


def node_value(score: Score, node: NodeScore, metric: str) -> float:
    """Return a metric of one estimator."""
    family, _, name = metric.partition(".")
    if family == "divergences":
        return float(node.divergence_step is not None)
    if family == "missing_estimates":
        return float(expected_estimates(score, node) - node.steps_scored)
    if family == "bound":
        return _or_nan(node.bound.outside if name == "outside" else node.bound.guaranteed)
    if family in ("nees", "nis"):
        return _consistency(node, node.nees if family == "nees" else node.nis, name)
    if family == "attack":
        return _attack(node, name)
    if family == "deviation":
        return _deviation(node, name)
    return _group_error(node, family, name)


def _deviation(node: NodeScore, name: str) -> float:
    if node.divergence_step is not None:
        return math.inf
    return math.nan if node.deviation is None else float(getattr(node.deviation, name))


def pooled_confusion(links: Sequence[LinkScore]) -> Confusion | None:
    """Return the confusion over the judged ones among some links; None when none is judged."""
    judged = [link.detector for link in links if link.detector is not None]
    if not judged:
        return None
    return Confusion.of(
        true_positive=sum(part.true_positive for part in judged),
        false_positive=sum(part.false_positive for part in judged),
        false_negative=sum(part.false_negative for part in judged),
        true_negative=sum(part.true_negative for part in judged),
    )


def _recovered(links: Sequence[LinkScore], name: str) -> float:
    """Return how well attacks were recovered on some links, their packets pooled."""
    parts = [link.recovered for link in links if link.recovered is not None]
    if name == "nees_ratio":
        parts = [part for part in parts if part.nees_ratio is not None]
    weights = [part.packets for part in parts]
    if not weights:
        return math.nan
    if name == "rmse":
        return math.sqrt(fmean([part.rmse**2 for part in parts], weights))
    return fmean([part.nees_ratio or 0.0 for part in parts], weights)


def link_value(chosen: LinkSet, metric: str) -> float:
    """Return a metric of a set of links, their packets pooled."""
    family, _, name = metric.partition(".")
    if family == "packets" and name in Traffic.COUNTS:
        return float(sum([getattr(link.traffic, name) for link in chosen.links]))
    if family == "packets":
        return _or_nan(getattr(chosen.traffic, name))
    if family == "lockouts":
        names = chosen.names
        return float(sum(lockout.link in names for lockout in chosen.score.lockouts))
    if family == "recovered":
        return _recovered(chosen.links, name)
    pooled = chosen.confusion
    if pooled is None:
        return math.nan
    if name == "missed_windows":
        return float(sum(window.delay is None for window in chosen.windows))
    return _or_nan(getattr(pooled, name))


def window_value(window: AttackWindow, metric: str) -> float:
    """Return a metric of one attack window on a judged link."""
    value = window.delay if metric == "detector.delay" else window.release
    return math.inf if value is None else float(value)


def _link_sets(score: Score, nodes: Collection[str], links: Collection[str]) -> list[LinkSet]:
    if not nodes and not links:
        return [LinkSet("all links", score.links, score)]
    named = [LinkSet(link.name, [link], score) for link in score.links if link.name in links]
    return named + [
        LinkSet(f"links into {node}", [link for link in score.links if link.destination == node], score)
        for node in nodes
    ]


def _node_values(score: Score, name: str, metric: Metric, nodes: Collection[str]) -> list[Value]:
    values = [
        (node.name, node_value(score, node, name)) for node in score.nodes if not nodes or node.name in nodes
    ]
    if metric.total and not nodes:
        return [("all estimators", sum(value for _, value in values))]
    return values


def _network_values(score: Score, nodes: Collection[str]) -> list[Value]:
    diverged = {node.name for node in score.nodes if node.divergence_step is not None}
    return [
        (
            f"{network.members[0]}..{network.members[-1]}",
            math.inf if diverged.intersection(network.members) else _or_nan(network.disagreement),
        )
        for network in score.networks
        if (not nodes or not set(nodes).isdisjoint(network.members))
    ]


def _sender_values(score: Score, nodes: Collection[str]) -> list[Value]:
    """Return the share of slots that each named sender used, or all with an event trigger together."""
    known = {sender.name: sender for sender in score.senders}
    if nodes:
        return [(name, _or_nan(known[name].rate) if name in known else math.nan) for name in nodes]
    whole = pooled_senders(score)
    return [(whole.name, _or_nan(whole.rate))]


def pooled_senders(score: Score, names: Collection[str] | None = None) -> SenderScore:
    """Return the nodes with an event trigger as one, all of them or those that are named."""
    chosen = [one for one in score.senders if names is None or one.name in names]
    slots, sent = sum(one.slots for one in chosen), sum(one.sent for one in chosen)
    return SenderScore.of("all event triggers", slots, sent)


def measure(
    score: Score, name: str, metric: Metric, nodes: Collection[str] = (), links: Collection[str] = ()
) -> list[Value]:
    """Return the values of a metric for what is named, or for the whole run.

    ``name`` is the metric's full name and ``metric`` its entry in the catalogue. A name that the run does not
    have gives no value.
    """
    if metric.scope == "node":
        return _node_values(score, name, metric, nodes)
    if metric.scope == "network":
        return _network_values(score, nodes)
    if metric.scope == "sender":
        return _sender_values(score, nodes)
    sets = _link_sets(score, nodes, links)
    if metric.scope == "link":
        return [(chosen.where, link_value(chosen, name)) for chosen in sets]
    return [
        (f"{window.link} from step {window.first}", window_value(window, name))
        for chosen in sets
        for window in chosen.windows
    ]
