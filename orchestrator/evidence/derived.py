"""What rows hold beyond the score: innovations, and the bound that no estimator can beat, where it is right.

The bound is that of `orchestrator.evidence.bound`, given the genuine measurements that were delivered in the
step in which they were sent: to the estimator itself, or, where it has neighbours, to any member of its
network, which bounds each of them. It is refused from the first step on in which it would be wrong.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from bus.kinds import load_class
from bus.plan import Plan, StagePlan
from orchestrator.evidence.bound import information, posterior_bound
from orchestrator.evidence.models import UnsuitedError, linear_model, registered_name
from orchestrator.evidence.nonlinear_bound import nonlinear_posterior_bound
from orchestrator.evidence.nonlinear_model import nonlinear_expectations
from orchestrator.evidence.observed import innovations_of
from orchestrator.registry import BUILT_IN
from orchestrator.score.accuracy import find_networks
from orchestrator.score.gather import Bools, Floats, Ints
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
    except UnsuitedError:
        return Derived(_nonlinear_bounds(plan, evidence), [np.zeros((0, 0))] * len(plan.estimators))
    told = np.array([information(C, R) for C, R in zip(model.C, model.R, strict=True)])
    bound = partial(posterior_bound, model.A, model.Q, model.initial_covariance, told)
    return Derived(_bounds(plan, bound, evidence), innovations_of(plan, model, evidence))


def _nonlinear_bounds(plan: Plan, evidence: Evidence) -> list[Bounded]:
    try:
        expected = nonlinear_expectations(plan)
    except UnsuitedError as error:
        nothing = np.full((plan.steps, evidence.gathered.estimates.state.shape[2]), np.nan)
        return [Bounded(nothing, "", str(error))] * len(plan.estimators)
    return _bounds(plan, partial(nonlinear_posterior_bound, expected), evidence)


def _observers(plan: Plan) -> list[list[int]]:
    """Return the estimators that share what they were told: networks of neighbours, and others alone."""
    linked = {name for own in plan.estimators for name in own.neighbours}
    linked |= {own.name for own in plan.estimators if own.neighbours}
    observers: list[list[int]] = []
    for members in find_networks(plan.estimators):
        together = plan.estimators[members[0]].name in linked
        observers += [members] if together else [[member] for member in members]
    return observers


def _bounds(plan: Plan, bound: Callable[[Bools], Floats], evidence: Evidence) -> list[Bounded]:
    """Return the bounds, given how they follow from which packets arrived (U, K, S)."""
    observers = _observers(plan)
    packets = evidence.gathered.measurements
    arrived = np.zeros((len(observers), plan.steps, len(plan.sensors)), dtype=bool)
    number = np.zeros(len(plan.estimators), dtype=np.int64)
    for i, members in enumerate(observers):
        number[members] = i
    genuine = packets.genuine
    arrived[number[packets.estimator[genuine]], packets.step[genuine], packets.sensor[genuine]] = True
    faults = [min(_faults(plan, evidence, members), default=(plan.steps, "")) for members in observers]
    last = max(first for first, _ in faults)
    covariance = bound(arrived[:, :last])
    found: list[Bounded | None] = [None] * len(plan.estimators)
    for i, (members, (first, reason)) in enumerate(zip(observers, faults, strict=True)):
        variance = np.full((plan.steps, covariance.shape[2]), np.nan)
        variance[:first] = np.diagonal(covariance[i, :first], axis1=1, axis2=2)
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
