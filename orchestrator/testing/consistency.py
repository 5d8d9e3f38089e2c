"""The claim that estimators are consistent: average NEES and NIS within chi-square bounds."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from orchestrator.evidence.consistency import by_step, overall_independent
from orchestrator.score.gather import Bools, Floats, Ints
from orchestrator.testing.claims import Claim, Names, Trial, estimators
from orchestrator.topology.resolved import Topology


def consistent(topology: Topology, trials: Sequence[Trial], node: Names, false_alarm: float) -> Claim:
    """Judge average NEES and NIS against chi-square bounds that a consistent filter keeps.

    NEES: in every step the sum over trials has the degrees of freedom of their states together. NIS: so has
    the sum over trials and steps (Bar-Shalom, Li and Kirubarajan 2001, section 5.4).
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
    lines += _divergences(trials, [names[i] for i in chosen])
    note = f"false-alarm rate of this assertion: {false_alarm:g}"
    ranked = sorted(off.items(), key=lambda item: -abs(math.log(item[1])))
    blamed = tuple((seed, f"{ratio:.3g}") for seed, ratio in ranked)
    return Claim((*lines, note) if lines else (), "average over the run's steps, farthest off 1", blamed)


def _figures(topology: Topology, trials: Sequence[Trial], i: int) -> dict[str, tuple[Floats, Ints]]:
    """Return NEES and NIS (M, K) of estimator i over M trials with their degrees of freedom."""
    counted: Bools = np.arange(topology.plan.steps) >= topology.score_options.from_step
    own = [trial.evidence.gathered.estimates for trial in trials]
    alive = np.array([trial.evidence.errors.alive[i] for trial in trials]) & counted
    nees = np.array([trial.evidence.nees[i] for trial in trials])
    nis = np.array([estimates.nis[i] for estimates in own])
    nees_dof = np.where(alive & np.isfinite(nees), own[0].error.shape[2], 0)
    nis_dof = np.where(alive & np.isfinite(nis), [estimates.nis_dof[i] for estimates in own], 0)
    found = {"NEES": (nees, nees_dof), "NIS": (nis, nis_dof)}
    return {name: (values, dof) for name, (values, dof) in found.items() if dof.any()}


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
