"""Every variant of a campaign read and checked before any trial begins."""

from __future__ import annotations

import pickle
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from orchestrator.backends.child import external_command
from orchestrator.campaign.grid import ATTACKS, NONE, GridError, Variant
from orchestrator.errors import InputError
from orchestrator.topology.experiment import topology_from_experiment
from orchestrator.topology.load import load_topology
from orchestrator.topology.problems import Problem, TopologyError
from orchestrator.topology.resolved import Topology


@dataclass(frozen=True)
class LoadedVariant:
    """A variant with its topology, at the first trial."""

    variant: Variant
    topology: Topology

    @cached_property
    def packed(self) -> bytes:
        """What a worker needs of it: the plan to run, and the topology as a log tells it, to score with."""
        logged = topology_from_experiment(self.topology.experiment_json())
        return pickle.dumps((self.topology.plan, logged), protocol=pickle.HIGHEST_PROTOCOL)


def load_variants(
    file: Path, variants: Sequence[Variant], seed: int | None, first_trial: int
) -> list[LoadedVariant]:
    """Return all variants ready to run.

    Raises
    ------
    InputError
        With everything that is wrong with any of them, each problem once, and with which variants.
    """
    loaded: list[LoadedVariant] = []
    problems: dict[Problem, list[Variant]] = {}
    for variant in variants:
        try:
            topology = load_topology(file, variant.overrides, seed, first_trial)
        except TopologyError as error:
            for problem in error.problems:
                problems.setdefault(problem, []).append(variant)
            continue
        loaded.append(LoadedVariant(variant, topology))
    if problems:
        raise TopologyError(_placed(problem, own, variants) for problem, own in problems.items())
    for own in loaded:
        _refuse_external(own.topology)
    return loaded


def refuse_alike(loaded: Sequence[LoadedVariant]) -> None:
    """Refuse variants that are one and the same topology under different names.

    Unattacked twins are alike where variants differ in what attacks do.

    Raises
    ------
    GridError
        Two settings come to the same; the text names both.
    """
    first: dict[tuple[str, int], Variant] = {}
    for own in loaded:
        if own.variant.settings.get(ATTACKS) == NONE:
            continue
        other = first.setdefault((own.topology.hash, own.topology.plan.seed), own.variant)
        if other is own.variant:
            continue
        settings = own.variant.settings
        apart = [f"{path}={value}" for path, value in settings.items() if value != other.settings[path]]
        raise GridError(
            f"--set: {own.variant} is the same topology as {other}: another --set overrides "
            f"{', '.join(apart)}, or both values mean the same; leave one of them out"
        )


def _placed(problem: Problem, having: Sequence[Variant], variants: Sequence[Variant]) -> Problem:
    """Return a problem with the settings of the variants that have it, unless all do or its place tells."""
    if not problem.line or len(having) == len(variants):
        return problem
    first, *others = (own.settings.items() for own in having)
    shared = ", ".join(f"{path}={value}" for path, value in first if all((path, value) in o for o in others))
    return replace(problem, message=f"{problem.message} (with {shared or having[0]})")


def _refuse_external(topology: Topology) -> None:
    plan = topology.plan
    external = [own.name for own in plan.estimators if external_command(plan, own.name) is not None]
    if external:
        raise InputError(
            f"{topology.path}: {', '.join(external)} cannot be swept: a trial runs in one process, and a "
            "program of your own does not; repeat 'gauntlet run' instead"
        )
