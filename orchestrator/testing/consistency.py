"""The claim that estimators are consistent: average NEES and NIS within chi-square bounds."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Sequence

import numpy as np

from orchestrator.evidence.consistency import by_step, overall_independent
from orchestrator.score.gather import Bools, Floats, Ints
from orchestrator.testing.claims import Claim, Names, Trial, estimators
from orchestrator.topology.resolved import Topology


def consistent(topology: Topology, trials: Sequence[Trial], node: Names, false_alarm: float) -> Claim:
    """Judge average NEES and NIS against chi-square bounds that a consistent filter keeps.

    NEES: in every step the sum over trials has the degrees of freedom of their states together. NIS: so has
    the sum over trials and steps (Bar-Shalom, Li and Kirubarajan 2001, section 5.4). An estimate whose
    covariance is not usable has no NEES, and fails the claim by itself.
    """
    if not 0.0 < false_alarm < 1.0:
        raise ValueError(f"false_alarm is {false_alarm:g}; give a probability between 0 and 1")
    names = [own.name for own in topology.plan.estimators]
    chosen = [names.index(name) for name in estimators(topology, node)]
    figures = {i: _figures(topology, trials, i) for i in chosen}
    judged = sum(len(found) for found in figures.values())
    lines, off = [], dict[int, float]()
    for i, found in figures.items():
        if not found:
            lines.append(f"{names[i]} publishes neither a usable covariance nor NIS")
        for figure, (values, dof) in found.items():
            line = _consistency_line(figure, names[i], values, dof, false_alarm / judged)
            if line:
                lines.append(line)
                _blame(trials, values, dof, off)
    unusable = {names[i]: _unusable(topology, trials, i) for i in chosen}
    lines += [_unusable_line(trials, name, *counts) for name, counts in unusable.items() if counts[0].any()]
    lines += _divergences(trials, [names[i] for i in chosen])
    note = f"false-alarm rate of this assertion: {false_alarm:g}"
    ranked = sorted(off.items(), key=lambda item: -abs(math.log(item[1])))
    blamed = tuple((seed, f"{ratio:.3g}") for seed, ratio in ranked)
    if lines and not blamed:
        return Claim((*lines, note), "without a usable covariance", _most_unusable(trials, unusable.values()))
    return Claim((*lines, note) if lines else (), "average over the run's steps, farthest off 1", blamed)


def _figures(topology: Topology, trials: Sequence[Trial], i: int) -> dict[str, tuple[Floats, Ints]]:
    """Return NEES and NIS (M, K) of estimator i over M trials with their degrees of freedom."""
    own = [trial.evidence.gathered.estimates for trial in trials]
    alive = _counted(topology, trials, i)
    nees = np.array([trial.evidence.nees[i] for trial in trials])
    nis = np.array([estimates.nis[i] for estimates in own])
    nees_dof = np.where(alive & np.isfinite(nees), own[0].error.shape[2], 0)
    nis_dof = np.where(alive & np.isfinite(nis), [estimates.nis_dof[i] for estimates in own], 0)
    found = {"NEES": (nees, nees_dof), "NIS": (nis, nis_dof)}
    return {name: (values, dof) for name, (values, dof) in found.items() if dof.any()}


def _counted(topology: Topology, trials: Sequence[Trial], i: int) -> Bools:
    """Return the steps (M, K) that are scored and in which estimator i has not diverged."""
    scored = np.arange(topology.plan.steps) >= topology.score_options.from_step
    alive: Bools = np.array([trial.evidence.errors.alive[i] for trial in trials]) & scored
    return alive


def _unusable(topology: Topology, trials: Sequence[Trial], i: int) -> tuple[Bools, Bools]:
    """Return the estimates (M, K) of estimator i with no usable covariance, and those that owe one.

    Every estimate of a state owes one, unless the estimator never publishes any: then it claims nothing.
    """
    own = [trial.evidence.gathered.estimates for trial in trials]
    owing = _counted(topology, trials, i) & np.array(
        [~np.isnan(estimates.error[i]).any(axis=1) for estimates in own]
    )
    published = np.array([np.isfinite(estimates.covariance[i]).all(axis=(1, 2)) for estimates in own])
    if not (owing & published).any():
        owing = np.zeros_like(owing)
    return owing & ~np.isfinite(np.array([trial.evidence.nees[i] for trial in trials])), owing


def _unusable_line(trials: Sequence[Trial], name: str, unusable: Bools, owing: Bools) -> str:
    first, step = np.argwhere(unusable)[0]
    return (
        f"{name} has no usable covariance in {unusable.sum()} of {owing.sum()} estimates: it is missing or "
        f"not positive definite, first at step {step} of seed {trials[first].seed}"
    )


def _most_unusable(
    trials: Sequence[Trial], unusable: Iterable[tuple[Bools, Bools]]
) -> tuple[tuple[int, str], ...]:
    """Return the seeds that lack usable covariances, those that lack most first, with how many they lack."""
    lacking = sum(counts.sum(axis=1) for counts, _ in unusable)
    ranked = sorted(zip(trials, np.asarray(lacking).tolist(), strict=True), key=lambda pair: -pair[1])
    return tuple((trial.seed, f"{count} estimates") for trial, count in ranked if count)


def _consistency_line(figure: str, name: str, values: Floats, dof: Ints, false_alarm: float) -> str:
    """Return what is wrong with a figure of an estimator, empty when nothing is."""
    if figure == "NIS":
        whole = overall_independent(values, dof, confidence=1.0 - false_alarm)
        if whole.low <= whole.ratio <= whole.high:
            return ""
        bounds = f"outside {whole.low:.4g} to {whole.high:.4g}"
        return (
            f"ANIS of {name} over its degrees of freedom is {whole.ratio:.4g}, {bounds} ({dof.sum()} of them)"
        )
    steps = int((dof.sum(axis=0) > 0).sum())
    found = by_step(values, dof, confidence=1.0 - false_alarm / steps)
    outside = np.flatnonzero((found.ratio < found.low) | (found.ratio > found.high))
    if not outside.size:
        return ""
    worst = int(outside[np.argmax(np.abs(np.log(np.maximum(found.ratio[outside], 1e-300))))])
    return (
        f"ANEES of {name} over its degrees of freedom is {found.ratio[worst]:.4g} at step {worst}, "
        f"outside {found.low[worst]:.4g} to {found.high[worst]:.4g}; "
        f"it is outside in {outside.size} of {steps} steps"
    )


def _blame(trials: Sequence[Trial], values: Floats, dof: Ints, off: dict[int, float]) -> None:
    """Note by seed the average of a figure over its degrees of freedom that is farthest off 1."""
    total = np.where(dof > 0, values, 0.0).sum(axis=1)
    for trial, part, whole in zip(trials, total.tolist(), dof.sum(axis=1).tolist(), strict=True):
        ratio = max(part / whole, 1e-300) if whole else 1.0
        if abs(math.log(ratio)) >= abs(math.log(off.get(trial.seed, 1.0))):
            off[trial.seed] = ratio


def _divergences(trials: Sequence[Trial], names: Sequence[str]) -> list[str]:
    seeds: dict[str, list[str]] = defaultdict(list)
    for trial in trials:
        for node in trial.score.nodes:
            if node.name in names and node.divergence_step is not None:
                seeds[node.name].append(str(trial.seed))
    return [f"{name} diverged at seed {', '.join(found)}" for name, found in seeds.items()]
