"""How far estimates are from the truth, and from one another."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bus.plan import EstimatorPlan
from orchestrator.score.gather import Bools, Estimates, Floats, Ints, ScoreError
from orchestrator.score.results import GroupError, NetworkScore

STATE = "state"


@dataclass(frozen=True)
class Errors:
    """Error norms by group (N, K), NaN where unknown, and when estimators diverged.

    ``divergence_step`` (N,) is -1 for an estimator that never diverged; ``alive`` (N, K) marks steps before
    it.
    """

    norm: Mapping[str, Floats]
    divergence_step: Ints
    alive: Bools


def number(value: float) -> float | None:
    """Return a figure for JSON: None where it is not finite."""
    return float(value) if math.isfinite(value) else None


def numbers(values: Floats) -> list[float | None]:
    """Return figures (K,) for JSON: None where one is not finite."""
    return [value if math.isfinite(value) else None for value in values.tolist()]


def root_mean_square(values: Floats, keep: Bools, axis: int) -> Floats:
    """Return the root mean square along an axis of the values that are kept and known; NaN over none."""
    counts = keep & ~np.isnan(values)
    with np.errstate(invalid="ignore", over="ignore"):
        total = np.sum(np.square(values, where=counts, out=np.zeros_like(values)), axis=axis)
        mean: Floats = np.sqrt(total / counts.sum(axis=axis))
    return mean


def _last_known(values: Floats, keep: Bools) -> Floats:
    """Return the last value of each row (N, K) that is kept and known; NaN where there is none."""
    known = keep & ~np.isnan(values)
    last = known.shape[1] - 1 - np.argmax(known[:, ::-1], axis=1)
    return np.where(known.any(axis=1), values[np.arange(len(values)), last], np.nan)


def find_errors(estimates: Estimates, state_groups: Mapping[str, Sequence[int]], bound: float) -> Errors:
    """Return the Euclidean error norms of each group and of ``state``, all of it.

    An estimator diverges at the first step at which it says so itself, or publishes a state whose error norm
    exceeds ``bound``.
    """
    n = estimates.error.shape[2]
    for group, indices in state_groups.items():
        if n and not all(0 <= index < n for index in indices):
            raise ScoreError(f"state group '{group}' names component {max(indices)} of a state of {n}")
    with np.errstate(over="ignore"):
        squared = np.square(estimates.error) if n else np.full((*estimates.error.shape[:2], 1), np.nan)
        norm = {
            group: np.sqrt(squared[:, :, list(indices) if n else [0]].sum(axis=2))
            for group, indices in state_groups.items()
        }
        norm[STATE] = np.sqrt(squared.sum(axis=2))
    diverged = estimates.declared_diverged | (norm[STATE] > bound)
    first = np.where(diverged.any(axis=1), diverged.argmax(axis=1), -1)
    steps = np.arange(diverged.shape[1])
    alive = (first[:, None] < 0) | (steps < first[:, None])
    return Errors(norm, first, alive)


def group_errors(errors: Errors, counted: Bools, attacked: Bools) -> list[dict[str, GroupError]]:
    """Return each estimator's errors by group over the steps in ``counted`` (K,).

    ``attacked`` (N, K) marks the steps in which an attacked packet reached the estimator.
    """
    nodes: list[dict[str, GroupError]] = [{} for _ in errors.divergence_step]
    for group, norm in errors.norm.items():
        whole = root_mean_square(norm, np.broadcast_to(counted, norm.shape), axis=1)
        hit = root_mean_square(norm, counted & attacked, axis=1)
        spared = root_mean_square(norm, counted & ~attacked, axis=1)
        peak = np.max(norm, axis=1, initial=-np.inf, where=counted & ~np.isnan(norm))
        final = _last_known(norm, np.broadcast_to(counted, norm.shape))
        figures = np.where(errors.divergence_step < 0, [whole, hit, spared, peak, final], np.nan)
        for node, own in zip(nodes, figures.T, strict=True):
            rmse, on, off, most, last = numbers(own)
            node[group] = GroupError(rmse=rmse, attacked=on, unattacked=off, peak=most, final=last)
    return nodes


def find_networks(estimators: Sequence[EstimatorPlan]) -> list[list[int]]:
    """Return groups of indices: connected through neighbours, or isolated and of one kind."""
    index = {estimator.name: i for i, estimator in enumerate(estimators)}
    linked = {name for estimator in estimators for name in estimator.neighbours}
    linked |= {estimator.name for estimator in estimators if estimator.neighbours}
    root = list(range(len(estimators)))

    def find(i: int) -> int:
        while root[i] != i:
            i = root[i]
        return i

    isolated: dict[str, int] = {}
    for i, estimator in enumerate(estimators):
        others = [index[name] for name in estimator.neighbours if name in index]
        if estimator.name not in linked:
            others = [isolated.setdefault(estimator.kind.reference, i)]
        for j in others:
            low, high = sorted((find(i), find(j)))
            root[high] = low
    groups: dict[int, list[int]] = {}
    for i in range(len(estimators)):
        groups.setdefault(find(i), []).append(i)
    return list(groups.values())


def network_score(
    members: Sequence[int], names: Sequence[str], estimates: Estimates, errors: Errors, counted: Bools
) -> NetworkScore:
    """Return the averages over the members of one network.

    Disagreement compares errors: the same as comparing estimates when all refer to one step, and right when
    one member predicts the next step while another filters this one.
    """
    alive = errors.alive[members]
    rmse = {
        group: numbers(root_mean_square(norm[members], alive, axis=0)) for group, norm in errors.norm.items()
    }
    error = np.where(alive[:, :, None], estimates.error[members], np.nan)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # no member at a step: NaN, as it should be
        deviation = np.sqrt(np.sum(np.square(error - np.nanmean(error, axis=0)), axis=2))
        several = np.sum(~np.isnan(deviation), axis=0) >= 2
        by_step = np.where(several, np.sqrt(np.nanmean(np.square(deviation), axis=0)), np.nan)
    whole = bool((errors.divergence_step[members] < 0).all())
    average = root_mean_square(by_step, counted, axis=0) if whole else np.nan
    return NetworkScore(
        members=[names[i] for i in members],
        rmse=rmse,
        disagreement=number(float(average)),
        disagreement_by_step=numbers(by_step),
    )
