"""What rows hold beyond the score: innovations, and the bound that no estimator can beat, where it is right.

The bound is that of `orchestrator.evidence.bound`, given the genuine measurements that were delivered in the
step in which they were sent: to the estimator itself, or, where it has neighbours, to any member of its
network, which bounds each of them. It is refused from the first step on in which it would be wrong.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from bus.kinds import load_class
from bus.plan import Plan, StagePlan
from orchestrator.evidence.bound import information, posterior_bound
from orchestrator.evidence.innovations import whitened_innovations
from orchestrator.evidence.models import LinearModel, UnsuitedError, linear_model, registered_name
from orchestrator.registry import BUILT_IN
from orchestrator.score.accuracy import find_networks
from orchestrator.score.gather import Bools, Floats, Gathered, Ints
from orchestrator.score.scoring import Evidence

OWN, NETWORK = "own packets", "packets of the network"


@dataclass(frozen=True)
class Bounded:
    """The bound of one estimator: ``variance`` (K, n) of each state component, NaN where refused.

    ``given`` tells whose packets it supposes; ``refused`` why it is not there, empty when it always is.
    """

    variance: Floats
    given: str
    refused: str


@dataclass(frozen=True)
class Derived:
    """By estimator: its bound, and its whitened innovations (K, M), empty where they cannot be had."""

    bounds: Sequence[Bounded]
    innovations: Sequence[Floats]


def derive(plan: Plan, evidence: Evidence) -> Derived:
    """Return what the record and the models of a run give."""
    try:
        model = linear_model(plan)
    except UnsuitedError as error:
        nothing = np.full((plan.steps, evidence.gathered.estimates.state.shape[2]), np.nan)
        return Derived(
            [Bounded(nothing, "", str(error))] * len(plan.estimators),
            [np.zeros((0, 0))] * len(plan.estimators),
        )
    return Derived(_bounds(plan, model, evidence), _innovations(plan, model, evidence))


def _observers(plan: Plan) -> list[list[int]]:
    """Return the estimators that share what they were told: networks of neighbours, and others alone."""
    linked = {name for own in plan.estimators for name in own.neighbours}
    linked |= {own.name for own in plan.estimators if own.neighbours}
    observers: list[list[int]] = []
    for members in find_networks(plan.estimators):
        together = plan.estimators[members[0]].name in linked
        observers += [members] if together else [[member] for member in members]
    return observers


def _bounds(plan: Plan, model: LinearModel, evidence: Evidence) -> list[Bounded]:
    observers = _observers(plan)
    packets = evidence.gathered.measurements
    arrived = np.zeros((len(observers), plan.steps, len(plan.sensors)), dtype=bool)
    number = np.zeros(len(plan.estimators), dtype=np.int64)
    for i, members in enumerate(observers):
        number[members] = i
    genuine = packets.genuine
    arrived[number[packets.estimator[genuine]], packets.step[genuine], packets.sensor[genuine]] = True
    told = np.array([information(C, R) for C, R in zip(model.C, model.R, strict=True)])
    covariance = posterior_bound(model.A, model.Q, model.initial_covariance, told, arrived)
    found: list[Bounded | None] = [None] * len(plan.estimators)
    for i, members in enumerate(observers):
        first, reason = min(_faults(plan, evidence, members), default=(plan.steps, ""))
        variance = np.diagonal(covariance[i], axis1=1, axis2=2).copy()
        variance[first:] = np.nan
        if 0 < first < plan.steps:
            reason = f"from step {first} on: {reason}"
        bounded = Bounded(variance, OWN if len(members) == 1 else NETWORK, reason)
        for member in members:
            found[member] = _of_member(plan, evidence, member, bounded)
    return [bounded for bounded in found if bounded is not None]


def _of_member(plan: Plan, evidence: Evidence, member: int, bounded: Bounded) -> Bounded:
    """Return the bound of a network for one member, unless what it estimates is not the current state."""
    estimates = evidence.gathered.estimates
    elsewhere = (estimates.refers_to[member] != np.arange(plan.steps)) & estimates.present[member]
    if not elsewhere.any():
        return bounded
    reason = f"{plan.estimators[member].name} estimates another step than the current one"
    return Bounded(np.full_like(bounded.variance, np.nan), bounded.given, reason)


def _first(steps: Bools | Ints) -> int:
    return int(np.min(steps))


def _faults(plan: Plan, evidence: Evidence, members: Sequence[int]) -> Iterator[tuple[int, str]]:
    """Yield from which step on the bound would be wrong, and why."""
    packets, judgement = evidence.gathered.measurements, evidence.judgement
    names = {plan.estimators[member].name for member in members}
    mine = np.isin(packets.estimator, members)
    changed = mine & ~packets.genuine & ~packets.late
    if changed.any():
        yield _first(packets.step[changed]), "a packet was not as its sensor had sent it"
    if (mine & packets.late).any():
        yield _first(packets.step[mine & packets.late]), "a packet came later than the step it was sent in"
    incoming = np.array([link.destination in names for link in plan.links], dtype=bool)
    attacked = judgement.attacked & incoming[judgement.link]
    if attacked.any():
        yield _first(judgement.step[attacked]), "an attacked packet was delivered"
    for signal in plan.signals:
        yield signal.timing.first, f"{signal.label} drives the plant"
    for stage in plan.stages:
        if any(link.destination in names and link.name in stage.streams for link in plan.links):
            yield from _stage_faults(stage)
    heard = {name for member in members for name in plan.estimators[member].sensors}
    for sensor, own in enumerate(plan.sensors):
        silent = np.flatnonzero(~packets.sent[sensor, : plan.silent_from(own.name)])
        if own.name in heard and silent.size:
            yield int(silent[0]), f"{own.name} kept quiet, which tells something too"


def _stage_faults(stage: StagePlan) -> Iterator[tuple[int, str]]:
    """Yield why what a stage loses may depend on what packets hold."""
    name = registered_name("impairments", stage.kind) or registered_name("attacks", stage.kind)
    reference = BUILT_IN["impairments"].get(name or "") or BUILT_IN["attacks"].get(name or "")
    if stage.timing.watches:
        yield stage.timing.first, f"{stage.label} acts on what it watches"
    elif reference is None:
        yield stage.timing.first, f"what {stage.label} loses may depend on what packets hold"
    elif not load_class(reference).open_loop:
        yield stage.timing.first, f"{stage.label} acts on what it sees"


def _innovations(plan: Plan, model: LinearModel, evidence: Evidence) -> list[Floats]:
    """Return the whitened innovations of each estimator; none where inputs drive the plant."""
    if plan.controllers:
        return [np.zeros((0, 0))] * len(plan.estimators)
    sensors = {own.name: i for i, own in enumerate(plan.sensors)}
    return [
        _of_estimator(plan, model, evidence, i, [sensors[name] for name in own.sensors])
        for i, own in enumerate(plan.estimators)
    ]


def _of_estimator(plan: Plan, model: LinearModel, evidence: Evidence, i: int, heard: Sequence[int]) -> Floats:
    from scipy.linalg import block_diag

    estimates = evidence.gathered.estimates
    ahead = (estimates.refers_to[i] - np.arange(plan.steps))[estimates.present[i]]
    if not heard or not ahead.size or ahead.min() != ahead.max() or ahead[0] not in (0, 1):
        return np.zeros((0, 0))
    n = len(model.A)
    A, Q = (model.A, model.Q) if ahead[0] == 0 else (np.eye(n), np.zeros((n, n)))
    C, R = np.concatenate([model.C[s] for s in heard]), block_diag(*(model.R[s] for s in heard))
    state, covariance = np.full((plan.steps, n), np.nan), np.full((plan.steps, n, n), np.nan)
    alive = evidence.errors.alive[i, :-1]
    state[1:][alive] = estimates.state[i, :-1][alive]
    covariance[1:][alive] = estimates.covariance[i, :-1][alive]
    measured = _measured(evidence.gathered, i, [(s, len(model.C[s])) for s in heard], plan.steps)
    return whitened_innovations(A, Q, C, R, state, covariance, measured)


def _measured(gathered: Gathered, i: int, heard: Sequence[tuple[int, int]], steps: int) -> Floats:
    """Return one measurement of every sensor in every step (K, M): the genuine one, or the first that came.

    One that came late is not of its step.
    """
    packets = gathered.measurements
    place, width = {}, 0
    for sensor, size in heard:
        place[sensor] = (width, width + size)
        width += size
    measured = np.full((steps, width), np.nan)
    mine = np.flatnonzero((packets.estimator == i) & ~packets.late)[::-1]
    for row in mine[np.argsort(packets.genuine[mine], kind="stable")].tolist():
        begin, end = place.get(int(packets.sensor[row]), (0, 0))
        if len(packets.values[row]) == end - begin:
            measured[packets.step[row], begin:end] = packets.values[row]
    return measured
