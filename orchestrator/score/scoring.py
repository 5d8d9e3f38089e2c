"""The score of a run: a pure function of its plan and its record."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import msgspec
import numpy as np

from bus.messages import Message
from bus.plan import Plan
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
    total_confusion,
)
from orchestrator.score.expectation import Expectation
from orchestrator.score.gather import Bools, Gathered, gather
from orchestrator.score.judging import judge_expectations
from orchestrator.score.results import Bound, LinkScore, NodeScore, Score, ScoreOptions
from orchestrator.score.traffic import senders, traffic


def _node_scores(
    plan: Plan, gathered: Gathered, errors: Errors, attacked: Bools, options: ScoreOptions
) -> list[NodeScore]:
    estimates = gathered.estimates
    steps = np.arange(plan.steps) >= options.from_step
    groups = group_errors(errors, steps, attacked)
    counted = errors.alive & steps
    with_state = counted & ~np.isnan(estimates.error).any(axis=2)
    figures = nees(estimates.error, estimates.covariance, with_state)
    dof = np.full(figures.shape, estimates.error.shape[2])
    nees_rows = consistency(figures, dof, counted, options.confidence)
    nis_rows, nis_hit, nis_spared = (
        consistency(estimates.nis, estimates.nis_dof, rows, options.confidence)
        for rows in (counted, counted & attacked, counted & ~attacked)
    )
    n = estimates.error.shape[2]
    left = [share_above(row[keep], n) for row, keep in zip(figures, counted, strict=True)]
    series = errors.norm if options.node_series else {}
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
            bound=Bound(outside=left[i], guaranteed=gathered.guaranteed.get(estimator.name)),
        )
        for i, estimator in enumerate(plan.estimators)
    ]


def _silent_from(plan: Plan, name: str) -> int | None:
    step = plan.silent_from(name)
    return step if step < plan.steps else None


def _measured(
    plan: Plan, gathered: Gathered, judgement: Judgement, errors: Errors, options: ScoreOptions
) -> Score:
    """Return the score before its expectations are judged."""
    names = [estimator.name for estimator in plan.estimators]
    counted = np.arange(plan.steps) >= options.from_step
    nodes = _node_scores(plan, gathered, errors, attacked_steps(plan, judgement), options)
    by_link, total = traffic(gathered)
    links = [
        LinkScore(
            name=link.name,
            source=link.source,
            destination=link.destination,
            stream=link.stream,
            traffic=packets,
            detector=detector,
        )
        for link, packets, detector in zip(plan.links, by_link, link_confusions(judgement), strict=True)
    ]
    complete = bool(gathered.truth_present.all()) and all(node.complete for node in nodes)
    return Score(
        name=plan.name,
        seed=plan.seed,
        trial=plan.trial,
        steps=plan.steps,
        period_s=plan.period_s,
        options=options,
        complete=complete,
        passed=complete,
        nodes=nodes,
        networks=[
            network_score(members, names, gathered.estimates, errors, counted)
            for members in find_networks(plan.estimators)
        ],
        links=links,
        traffic=total,
        detector=total_confusion(judgement),
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

    Raises
    ------
    ScoreError
        The record cannot belong to the plan, or an expectation names a metric that does not exist.
    """
    options = options or ScoreOptions()
    gathered = gather(plan, records)
    errors = find_errors(gathered.estimates, state_groups, options.divergence_bound)
    measured = _measured(plan, gathered, judge(plan, gathered), errors, options)
    outcomes = judge_expectations(measured, expectations, state_groups)
    passed = measured.complete and all(outcome.passed for outcome in outcomes)
    return msgspec.structs.replace(measured, expectations=outcomes, passed=passed)
