"""From a record to rows: one row an estimator, the same for a single run and for a trial of a campaign.

Scalars are None where undefined and infinite where unbounded, as in `orchestrator.score.measure`. Series and
other lists are arrays, one entry a step, a packet or an attack window; NaN where there is nothing.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from bus.keys import EXCHANGE
from bus.messages import Message
from bus.plan import EstimatorPlan, Plan
from orchestrator.evidence.derived import Derived, derive
from orchestrator.score.accuracy import STATE
from orchestrator.score.attack_beliefs import AttackBeliefs
from orchestrator.score.catalogue import find_metric, metric_names
from orchestrator.score.gather import Gathered, gather
from orchestrator.score.link_results import AttackWindow
from orchestrator.score.measure import LinkSet, link_value, measure, node_value, pooled_senders
from orchestrator.score.results import Score
from orchestrator.score.scoring import Evidence
from orchestrator.topology.resolved import Topology
from orchestrator.topology_score import score_topology

SCORED, FAILED = "scored", "failed"

Row = dict[str, Any]
"""A row by column; what each column means stands in `orchestrator.evidence.table`."""


def trial_rows(
    topology: Topology, records: Iterable[tuple[str, Message]], departed: Mapping[str, int] | None = None
) -> list[Row]:
    """Return the rows of one run, one an estimator in the plan's order; ``variant`` is 0.

    Parameters
    ----------
    topology
        What was run. That of a log names methods as topologies do (``kalman``); one that is ready to run by
        their classes.
    records
        The record: (topic, message) pairs, from a log or from memory.
    departed
        The first silent step of each node that died and that the others outlived.
    """
    return gathered_rows(topology, gather(topology.plan, records), departed)


def gathered_rows(
    topology: Topology, gathered: Gathered, departed: Mapping[str, int] | None = None
) -> list[Row]:
    """Return the rows of a record that is gathered already; see `trial_rows`."""
    plan, groups = topology.plan, topology.state_groups
    score, evidence = score_topology(topology, gathered, departed)
    node_number = {name: number for number, name in enumerate(plan.node_names)}
    facts = _facts(plan) | {"status": SCORED, "passed": score.passed, "complete": score.complete}
    deviation = _disagreement(score)
    scalars = _scalars(score, groups, {own.name: _senders(plan, own) for own in plan.estimators})
    by_node = _packets(plan, evidence)
    derived = derive(plan, evidence)
    return [
        {
            **facts,
            "node": node.name,
            "method": node.method,
            "network": network,
            "privileged": ", ".join(node.privileged),
            "divergence_step": node.divergence_step,
            **{name: values.get(node.name) for name, values in scalars.items()},
            **_series(plan, evidence, i, node_number),
            "disagreement_by_step": deviation[network],
            **by_node[i],
            **_windows(score, node.name),
            **_derived(derived, i, groups),
        }
        for i, (node, network) in enumerate(zip(score.nodes, _networks(score), strict=True))
    ]


def failed_row(plan: Plan, message: str) -> Row:
    """Return the one row of a trial that came to no score."""
    return _facts(plan) | {"status": FAILED, "message": message, "passed": False, "complete": False}


def _facts(plan: Plan) -> Row:
    return {"variant": 0, "trial": plan.trial, "seed": plan.seed, "node": "", "method": "", "message": ""}


def _networks(score: Score) -> list[int]:
    network = {member: number for number, own in enumerate(score.networks) for member in own.members}
    return [network[node.name] for node in score.nodes]


def _disagreement(score: Score) -> list[np.ndarray[Any, np.dtype[np.float64]]]:
    return [np.array(network.disagreement_by_step, dtype=np.float64) for network in score.networks]


def _scalars(
    score: Score, groups: Collection[str], senders: Mapping[str, Collection[str]]
) -> dict[str, dict[str, float | None]]:
    """Return every metric that has one value for an estimator, its incoming links or its network, by node.

    What is measured of senders is that of those that serve the estimator, pooled. Metrics of attack windows
    stand in the rows' own columns for windows.
    """
    into = {
        name: [link for link in score.links if link.destination == name]
        for name in (node.name for node in score.nodes)
    }
    sets = {name: LinkSet(f"links into {name}", links, score) for name, links in into.items()}
    found: dict[str, dict[str, float | None]] = {}
    for name in scalar_names(groups):
        metric = find_metric(name, groups)
        assert metric is not None
        if metric.scope == "node":
            values = {node.name: node_value(score, node, name) for node in score.nodes}
        elif metric.scope == "link":
            values = {node: link_value(chosen, name) for node, chosen in sets.items()}
        elif metric.scope == "sender":
            rates = {node: pooled_senders(score, serving).rate for node, serving in senders.items()}
            values = {node: math.nan if rate is None else rate for node, rate in rates.items()}
        else:
            values = {
                node.name: measure(score, name, metric, nodes=[node.name])[0][1] for node in score.nodes
            }
        found[name] = {node: _scalar(value) for node, value in values.items()}
    return found


def scalar_names(groups: Collection[str]) -> list[str]:
    """Return the metrics that have one value for an estimator, given the plant's state groups."""
    scopes = {name: find_metric(name, groups) for name in metric_names(groups)}
    return [name for name, metric in scopes.items() if metric is not None and metric.scope != "window"]


def _scalar(value: float) -> float | None:
    return None if math.isnan(value) else value


def _series(plan: Plan, evidence: Evidence, i: int, node_number: Mapping[str, int]) -> Row:
    """Return what estimator i showed at every step."""
    estimates, own = evidence.gathered.estimates, plan.estimators[i]
    senders = _senders(plan, own)
    numbers = [node_number[name] for name in senders]
    dof = estimates.nis_dof[i]
    return {
        **{f"error.{group}": norm[i] for group, norm in evidence.errors.norm.items()},
        "nees": evidence.nees[i],
        "nis": np.where(dof > 0, estimates.nis[i], np.nan),
        "nis_dof": dof,
        "attacked": evidence.attacked[i],
        "sent": evidence.gathered.sent[numbers].sum(axis=0),
        "slots": sum(senders.values()),
        **_of_signal_attacks(evidence.gathered.attack_beliefs, i),
    }


def _of_signal_attacks(beliefs: AttackBeliefs, i: int) -> Row:
    """Return what estimator i said of each step's signal attack: its probability, the error of its signal.

    The error is that of the estimate given that there is an attack, in the steps in which there was one.
    Beside it stands whether there was one: None where its truth is missing.
    """
    about = beliefs.about[i]
    said = np.flatnonzero(about >= 0)
    probability, error = (np.full(about.size, np.nan) for _ in range(2))
    probability[about[said]] = beliefs.probability[i, said]
    if beliefs.signal.shape[1]:
        at = about[said]
        apart = np.linalg.norm(beliefs.value[i, said] - beliefs.signal[at], axis=1)
        error[at] = np.where(beliefs.on[at], apart, np.nan)
    on: np.ndarray[Any, Any] = beliefs.on
    if not beliefs.known.all():
        on = on.astype(object)
        on[~beliefs.known] = None
    return {"attack_on": on, "attack_probability": probability, "attack_error": error}


def _derived(derived: Derived, i: int, groups: Mapping[str, Sequence[int]]) -> Row:
    """Return the bound of estimator i by state group, in the units of its RMSE, and its innovations."""
    bounded = derived.bounds[i]
    every = range(bounded.variance.shape[1])
    return {
        **{
            f"pcrb.{group}": np.sqrt(bounded.variance[:, list(indices)].sum(axis=1))
            for group, indices in {**groups, STATE: every}.items()
        },
        "pcrb.given": bounded.given,
        "pcrb.refused": bounded.refused,
        "innovation": derived.innovations[i].ravel(),
        "state_size": bounded.variance.shape[1],
    }


def _senders(plan: Plan, own: EstimatorPlan) -> dict[str, int]:
    """Return whose sending serves an estimator, its sensors' and its own, with their slots in a step."""
    senders = dict.fromkeys(own.sensors, 1)
    return {**senders, own.name: own.rounds} if plan.is_heard(own.name, EXCHANGE) else senders


def _packets(plan: Plan, evidence: Evidence) -> list[Row]:
    """Return by estimator the packets that reached it on links on which some verdict was given."""
    judgement = evidence.judgement
    receivers = {link.destination for link in plan.links}
    numbers = {name: number for number, name in enumerate(sorted(receivers))}
    receiver = np.array([numbers[link.destination] for link in plan.links], dtype=np.int64)
    names = np.array([link.name for link in plan.links], dtype=object)
    judged = np.flatnonzero(judgement.judged[judgement.link])
    receives = receiver[judgement.link[judged]]
    rows = []
    for estimator in plan.estimators:
        mine = judged[receives == numbers.get(estimator.name, -1)]
        rows.append(
            {
                "packet.step": judgement.step[mine],
                "packet.link": names[judgement.link[mine]],
                "packet.statistic": judgement.statistic[mine],
                "packet.attacked": judgement.attacked[mine],
                "packet.alarm": judgement.alarm[mine],
            }
        )
    return rows


def _windows(score: Score, node: str) -> Row:
    """Return the attack windows on the links into a node."""
    incoming = {link.name for link in score.links if link.destination == node}
    windows = [window for window in score.windows if window.link in incoming]
    columns: Mapping[str, Sequence[Any]] = {
        "link": [window.link for window in windows],
        "stage": [window.stage for window in windows],
        "first": [window.first for window in windows],
        "last": [window.last for window in windows],
        "judged": [window.judged for window in windows],
        "delay": [math.nan if window.delay is None else float(window.delay) for window in windows],
        "end": [_end(window, score) for window in windows],
    }
    return {f"window.{name}": values for name, values in columns.items()}


def _end(window: AttackWindow, score: Score) -> int:
    """Return the last step in which an alarm could have counted as the detection of an attack window."""
    return min(window.last + score.options.detection_grace, score.steps - 1)
