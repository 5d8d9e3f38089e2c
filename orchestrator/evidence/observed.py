"""The innovations of every estimator of a run, from its record."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bus.plan import Plan
from orchestrator.evidence.innovations import whitened_innovations
from orchestrator.evidence.models import LinearModel
from orchestrator.score.gather import Floats, Ints
from orchestrator.score.measurements import Measurements
from orchestrator.score.scoring import Evidence


def innovations_of(plan: Plan, model: LinearModel, evidence: Evidence) -> list[Floats]:
    """Return the whitened innovations (K, M) of each estimator; empty where they cannot be had.

    The components are those of the sensors that it hears, in the plan's order. None can be had where inputs
    drive the plant, and of an estimator that does not estimate the current step or the next throughout.
    """
    found = [np.zeros((0, 0))] * len(plan.estimators)
    if plan.controllers:
        return found
    sensors = {own.name: i for i, own in enumerate(plan.sensors)}
    heard = [[sensors[name] for name in own.sensors] for own in plan.estimators]
    size = np.array([len(C) for C in model.C], dtype=np.int64)
    alike: dict[tuple[int, int], list[int]] = {}
    for i, ahead in enumerate(_steps_ahead(plan, evidence)):
        if heard[i] and ahead in (0, 1):
            alike.setdefault((int(size[heard[i]].sum()), ahead), []).append(i)
    for (_, ahead), members in alike.items():
        white = _together(plan, model, evidence, members, [heard[i] for i in members], ahead)
        for i, own in zip(members, white, strict=True):
            found[i] = own
    return found


def _steps_ahead(plan: Plan, evidence: Evidence) -> list[int]:
    """Return how many steps ahead each estimator estimates, -1 when that changes or is not known."""
    estimates = evidence.gathered.estimates
    ahead = estimates.refers_to - np.arange(plan.steps)
    return [
        int(own[0]) if own.size and own.min() == own.max() else -1
        for own in (row[present] for row, present in zip(ahead, estimates.present, strict=True))
    ]


def _together(
    plan: Plan,
    model: LinearModel,
    evidence: Evidence,
    members: Sequence[int],
    heard: Sequence[Sequence[int]],
    ahead: int,
) -> Floats:
    """Return the innovations (E, K, M) of estimators that hear as many components each."""
    n, estimates = len(model.A), evidence.gathered.estimates
    A, Q = (model.A, model.Q) if ahead == 0 else (np.eye(n), np.zeros((n, n)))
    C = np.array([np.concatenate([model.C[s] for s in own]) for own in heard])
    R = np.array([_block_diagonal([model.R[s] for s in own]) for own in heard])
    state = np.full((len(members), plan.steps, n), np.nan)
    covariance = np.full((len(members), plan.steps, n, n), np.nan)
    alive = evidence.errors.alive[members, :-1, None]
    state[:, 1:] = np.where(alive, estimates.state[members, :-1], np.nan)
    covariance[:, 1:] = np.where(alive[..., None], estimates.covariance[members, :-1], np.nan)
    measured = _measured(evidence.gathered.measurements, members, heard, model, (plan.steps, C.shape[1]))
    return whitened_innovations(A, Q, C, R, state, covariance, measured)


def _block_diagonal(blocks: Sequence[Floats]) -> Floats:
    size = sum(map(len, blocks))
    whole, begin = np.zeros((size, size)), 0
    for block in blocks:
        end = begin + len(block)
        whole[begin:end, begin:end] = block
        begin = end
    return whole


def _measured(
    packets: Measurements,
    members: Sequence[int],
    heard: Sequence[Sequence[int]],
    model: LinearModel,
    shape: tuple[int, int],
) -> Floats:
    """Return a measurement of every sensor in every step (E, K, M): the genuine one, or the first that came.

    One that came late is not of its step.
    """
    sizes = np.array([len(C) for C in model.C], dtype=np.int64)
    begin: Ints = np.full((int(packets.estimator.max(initial=max(members))) + 1, len(sizes)), -1)
    place: Ints = np.full(len(begin), -1)
    for row, (member, own) in enumerate(zip(members, heard, strict=True)):
        begin[member, own] = np.cumsum([0, *sizes[own]])[:-1]
        place[member] = row
    fits = begin[packets.estimator, packets.sensor] >= 0
    fits &= ~packets.late & (packets.size == sizes[packets.sensor])
    rows = np.flatnonzero(fits)[::-1]
    rows = rows[np.argsort(packets.genuine[rows], kind="stable")]  # what is written last stays
    width = packets.size[rows]
    inside = np.arange(width.sum()) - np.repeat(np.cumsum(width) - width, width)
    offset = np.cumsum(packets.size) - packets.size
    estimator, sensor = packets.estimator[rows], packets.sensor[rows]
    measured = np.full((len(members), *shape), np.nan)
    measured[
        np.repeat(place[estimator], width),
        np.repeat(packets.step[rows], width),
        np.repeat(begin[estimator, sensor], width) + inside,
    ] = packets.values[np.repeat(offset[rows], width) + inside]
    return measured
