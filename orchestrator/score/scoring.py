"""The score of a run: a pure function of its plan and its record."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import msgspec
import numpy as np

from bus.messages import Message
from bus.plan import FaultPlan, Plan
from orchestrator.score.accuracy import (
    Errors,
    find_errors,
    find_networks,
    group_errors,
    network_score,
    numbers,
)
from orchestrator.score.consistency import consistency, nees, share_above
from orchestrator.score.detection import (
    Judgement,
    attack_windows,
    attacked_steps,
    find_lockouts,
    judge,
    link_confusions,
)
from orchestrator.score.deviation import deviations
from orchestrator.score.expectation import Expectation
from orchestrator.score.gather import Bools, Floats, Gathered, gather
from orchestrator.score.judging import judge_expectations
from orchestrator.score.link_results import LinkScore
from orchestrator.score.measure import pooled_confusion
from orchestrator.score.results import Bound, NodeScore, Score, ScoreOptions
from orchestrator.score.signal_attacks import attack_scores
from orchestrator.score.traffic import senders, traffic


@dataclass(frozen=True)
class Evidence:
    """What a score is computed from, as arrays by estimator and step (N, K).

    ``attacked`` marks the steps in which an attacked packet reached an estimator, or an attack the plant.
    ``nees`` is NaN from an estimator's divergence on, and where there is none.
    """

    gathered: Gathered
    errors: Errors
    judgement: Judgement
    attacked: Bools
    nees: Floats


def _find_evidence(
    plan: Plan, gathered: Gathered, state_groups: Mapping[str, Sequence[int]], options: ScoreOptions
) -> Evidence:
    estimates = gathered.estimates
    errors = find_errors(estimates, state_groups, options.divergence_bound)
    judgement = judge(plan, gathered)
    figures = nees(estimates.error, estimates.covariance, errors.alive)
    return Evidence(gathered, errors, judgement, attacked_steps(plan, judgement), figures)


def _node_scores(plan: Plan, evidence: Evidence, options: ScoreOptions) -> list[NodeScore]:
    estimates, errors, attacked = evidence.gathered.estimates, evidence.errors, evidence.attacked
    steps = np.arange(plan.steps) >= options.from_step
    groups = group_errors(errors, steps, attacked)
    counted = errors.alive & steps
    with_state = counted & ~np.isnan(estimates.error).any(axis=2)
    dof = np.full(counted.shape, estimates.error.shape[2])
    nees_rows = consistency(evidence.nees, dof, counted, options.confidence)
    nis_rows, nis_hit, nis_spared = (
        consistency(estimates.nis, estimates.nis_dof, rows, options.confidence)
        for rows in (counted, counted & attacked, counted & ~attacked)
    )
    apart = deviations(plan, estimates, errors, steps, options.reference)
    n = estimates.error.shape[2]
    left = [share_above(row[keep], n) for row, keep in zip(evidence.nees, counted, strict=True)]
    series = errors.norm if options.node_series else {}
    attacks = attack_scores(evidence.gathered.attack_beliefs, errors, options.from_step)
    return [
        NodeScore(
            name=estimator.name,
            method=estimator.kind.reference.rpartition(":")[2],
            complete=bool(estimates.present[i, : plan.silent_from(estimator.name)].all()),
            silent_from=_silent_from(plan, estimator.name),
            steps_scored=int(estimates.present[i].sum()),
            divergence_step=int(errors.divergence_step[i]) if errors.divergence_step[i] >= 0 else None,
            attacked_steps=int(attacked[i].sum()),
            groups=groups[i],
            nees=nees_rows[i],
            nees_undefined=int(with_state[i].sum()) - nees_rows[i].samples,
            nis=nis_rows[i],
            nis_attacked=nis_hit[i],
            nis_unattacked=nis_spared[i],
            error={group: numbers(norm[i]) for group, norm in series.items()},
            attack=attacks[i],
            deviation=apart[i],
            privileged=list(dict.fromkeys(label.partition("/")[0] for label in estimator.oracles)),
            bound=Bound(outside=left[i], guaranteed=evidence.gathered.guaranteed.get(estimator.name)),
        )
        for i, estimator in enumerate(plan.estimators)
    ]


def _silent_from(plan: Plan, name: str) -> int | None:
    step = plan.silent_from(name)
    return step if step < plan.steps else None


def _recorded(plan: Plan, gathered: Gathered) -> int:
    """Return the number of steps of which the truth and every estimate that is owed stand in the record."""
    whole = gathered.truth_present.copy()
    for i, estimator in enumerate(plan.estimators):
        owed = slice(0, plan.silent_from(estimator.name))
        whole[owed] &= gathered.estimates.present[i, owed]
    return int(whole.sum())


def _measured(plan: Plan, evidence: Evidence, options: ScoreOptions) -> Score:
    """Return the score before its expectations are judged."""
    gathered, judgement = evidence.gathered, evidence.judgement
    names = [estimator.name for estimator in plan.estimators]
    counted = np.arange(plan.steps) >= options.from_step
    nodes = _node_scores(plan, evidence, options)
    by_link, total = traffic(gathered)
    recovered = gathered.false_data.recovered(len(plan.links), options.from_step)
    links = [
        LinkScore(
            name=link.name,
            source=link.source,
            destination=link.destination,
            stream=link.stream,
            traffic=packets,
            detector=detector,
            recovered=attack,
        )
        for link, packets, detector, attack in zip(
            plan.links, by_link, link_confusions(judgement), recovered, strict=True
        )
    ]
    recorded = _recorded(plan, gathered)
    return Score(
        name=plan.name,
        seed=plan.seed,
        trial=plan.trial,
        steps=plan.steps,
        period_s=plan.period_s,
        options=options,
        steps_recorded=recorded,
        complete=recorded == plan.steps,
        passed=recorded == plan.steps,
        nodes=nodes,
        networks=[
            network_score(members, names, gathered.estimates, evidence.errors, counted)
            for members in find_networks(plan.estimators)
        ],
        links=links,
        traffic=total,
        detector=pooled_confusion(links),
        unmatched_verdicts=judgement.unmatched_verdicts,
        windows=attack_windows(plan, judgement, options.detection_grace),
        lockouts=find_lockouts(plan, judgement, options.lockout_length),
        expectations=[],
        senders=senders(plan, gathered),
    )


def score(
    plan: Plan,
    records: Iterable[tuple[str, Message]],
    *,
    state_groups: Mapping[str, Sequence[int]],
    options: ScoreOptions | None = None,
    expectations: Sequence[Expectation] = (),
    departed: Mapping[str, int] | None = None,
) -> Score:
    """Return the score of a run.

    Parameters
    ----------
    plan
        The run, as it was launched or as its log tells.
    records
        The record: (topic, message) pairs, from a log or from memory. The order inside a step does not
        matter.
    state_groups
        Names for parts of the state, by index, as the plant gives them.
    options
        What to count and what to call diverged or locked out; None for `ScoreOptions` as it is.
    expectations
        What to hold against the score.
    departed
        The first silent step of each node that died though the plan did not have it so, and that the others
        outlived: what it owed from there on is not missed.

    Raises
    ------
    ScoreError
        The record cannot belong to the plan, or an expectation names a metric that does not exist.
    """
    result, _ = score_gathered(
        plan,
        gather(plan, records),
        state_groups=state_groups,
        options=options,
        expectations=expectations,
        departed=departed,
    )
    return result


def score_gathered(
    plan: Plan,
    gathered: Gathered,
    *,
    state_groups: Mapping[str, Sequence[int]],
    options: ScoreOptions | None = None,
    expectations: Sequence[Expectation] = (),
    departed: Mapping[str, int] | None = None,
) -> tuple[Score, Evidence]:
    """Return the score of a record that is gathered already, and what it was computed from; see `score`."""
    options = options or ScoreOptions()
    deaths = dict(departed or {})
    ends = [FaultPlan(node, "crash", step) for node, step in deaths.items()]
    plan = dataclasses.replace(plan, faults=(*plan.faults, *ends))
    evidence = _find_evidence(plan, gathered, state_groups, options)
    measured = _measured(plan, evidence, options)
    outcomes = judge_expectations(measured, expectations, state_groups)
    passed = measured.complete and all(outcome.passed for outcome in outcomes)
    whole = msgspec.structs.replace(measured, expectations=outcomes, passed=passed, departed=deaths)
    return whole, evidence
