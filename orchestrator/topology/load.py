"""Topology files in, plans out: `load_topology` is where everything that runs a topology begins."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from orchestrator.backends.contract import RunSettings
from orchestrator.topology.adversary import granted, integrity_of
from orchestrator.topology.construction import (
    EstimatorBuilder,
    build_controllers,
    build_plant,
    build_sensors,
    build_stages,
    check_signals,
)
from orchestrator.topology.draft import CheckedKind, Draft
from orchestrator.topology.expecting import read_expectations
from orchestrator.topology.graph import Graph, read_graph
from orchestrator.topology.inheritance import pruned, read_with_bases
from orchestrator.topology.listening import listeners, warn_of_unheard
from orchestrator.topology.oracles import check_listeners, granted_patterns, oracles_of
from orchestrator.topology.outlived import outlived_nodes
from orchestrator.topology.overrides import apply_overrides
from orchestrator.topology.placement import place
from orchestrator.topology.problems import Origin, Problem, Problems, TopologyError
from orchestrator.topology.resolve import Kinds, links_between, make_plan, resolved_document
from orchestrator.topology.resolved import Topology
from orchestrator.topology.stages import declared_attacks, declared_channels, refuse_repeated_names
from orchestrator.topology.targets import check_targets
from orchestrator.topology.triggers import (
    build_triggers,
    check_senders,
    declared_triggers,
    warn_of_mistaken_silence,
)
from orchestrator.topology.wiring import wire

__all__ = ["Problem", "Topology", "TopologyError", "find_problems", "load_topology"]


def load_topology(
    path: Path | str,
    overrides: Iterable[str] = (),
    seed: int | None = None,
    trial: int | None = None,
    directory: Path | None = None,
) -> Topology:
    """Return a topology that is ready to run.

    Parameters
    ----------
    path
        The topology file.
    overrides
        Changes ``dotted.path=value``, applied in turn.
    seed, trial
        Replace those of the file; as the overrides ``seed=...`` and ``trial=...`` would.
    directory
        What relative paths in overrides refer to; None for the current directory.

    Raises
    ------
    TopologyError
        With everything that is wrong, each with its place and cure.
    """
    file = Path(path)
    stated = {"seed": seed, "trial": trial}
    numbers = [f"{key}={value}" for key, value in stated.items() if value is not None]
    draft = _drafted(file, [*overrides, *numbers], directory)
    if is_base(file):
        runnable = [other.name for other in sorted(file.parent.glob("*.yaml")) if not is_base(other)]
        cure = f"run a file that extends it: {', '.join(runnable) or 'there is none beside it'}"
        draft.problems.add(Origin(str(file), 0, file.parent), "", "is a base for other topologies", cure)
        raise TopologyError(draft.problems)
    return _finished(draft, file)


def find_problems(
    path: Path | str, overrides: Iterable[str] = ()
) -> tuple[tuple[Problem, ...], tuple[Problem, ...]]:
    """Return all errors and all warnings of a topology file; a base may leave out what its heirs must say."""
    file = Path(path)
    try:
        draft = _drafted(file, overrides)
        if is_base(file):
            return tuple(draft.problems), tuple(draft.warnings)
        return (), _finished(draft, file).warnings
    except TopologyError as error:
        return error.problems, ()


def is_base(file: Path) -> bool:
    """Return whether a file's name says that others extend it and that it is not run itself."""
    return file.name.startswith("_")


def _drafted(file: Path, overrides: Iterable[str], directory: Path | None = None) -> Draft:
    """Return the merged topology with its sections checked one by one."""
    problems = Problems()
    merged = read_with_bases(file, problems)
    if merged is None:
        raise TopologyError(problems)
    root = pruned(apply_overrides(merged, overrides, problems, directory))
    draft = Draft(root, problems, incomplete=is_base(file), sound=not len(problems))
    draft.check_sections()
    return draft


def _finished(draft: Draft, file: Path) -> Topology:
    kinds = Kinds(
        draft.check_node_kind("plant", ("plant",)),
        _node_kinds(draft, "sensors"),
        _node_kinds(draft, "estimators"),
        _node_kinds(draft, "controllers"),
        declared_attacks(draft),
        declared_channels(draft),
        declared_triggers(draft),
    )
    graph = read_graph(draft)
    refuse_repeated_names(draft, [*kinds.attacks, *kinds.channels])
    listens = _check_names(draft, kinds) if draft.sound else {}
    draft.problems.stop_if_any()
    return _wired(draft, file, kinds, listens, graph)


def _check_names(draft: Draft, kinds: Kinds) -> dict[str, list[str]]:
    """Check what refers to nodes by their names; return whom each estimator listens to."""
    if "estimators" in draft.sections and not draft.names("estimators"):
        draft.complain(("estimators",), "there are no estimators", "for example e1..e4")
    for name in set(draft.names("sensors")) & set(draft.names("estimators")):
        cure = f"call them s{name} and e{name}, for example"
        draft.complain(("estimators", name), f"'{name}' is both a sensor and an estimator", cure)
    for name in set(draft.names("controllers")) & {*draft.names("sensors"), *draft.names("estimators")}:
        draft.complain(("controllers", name), f"'{name}' is another node's name too", f"call it c{name}")
    check_targets(draft, kinds.attacks)
    return listeners(draft, kinds.estimators)


def _node_kinds(draft: Draft, section: str) -> dict[str, CheckedKind]:
    checked = {name: draft.check_node_kind(section, (section, name)) for name in draft.names(section)}
    return {name: kind for name, kind in checked.items() if kind is not None}


def _wired(
    draft: Draft, file: Path, kinds: Kinds, listens: dict[str, list[str]], graph: Graph | None
) -> Topology:
    """Build every object once, wire the estimators, and put the stages on the links."""
    assert kinds.plant is not None
    plant = build_plant(draft, kinds.plant)
    draft.problems.stop_if_any()
    assert plant is not None
    sensors = build_sensors(draft, kinds.sensors, plant)
    build_triggers(draft, kinds.triggers, plant, sensors)
    draft.problems.stop_if_any()
    grants = granted_patterns(draft)
    builder = EstimatorBuilder(draft, kinds.estimators, plant, sensors, listens, kinds.triggers, grants)
    wiring = wire(draft, graph, kinds.estimators, builder)
    if not len(draft.problems):  # an estimator that was refused exchanges nothing
        check_senders(draft, kinds, wiring)
        built = {name: builder.build(name, wiring.neighbours[name]) for name in grants}
        check_listeners(draft, grants, built)
    build_controllers(draft, kinds.controllers, kinds.estimators, plant)
    check_signals(draft, kinds.attacks, plant)
    _refuse_idle(draft, listens, wiring.neighbours)
    warn_of_unheard(draft, listens)
    draft.problems.stop_if_any()
    heard_by = {name: own.estimator for name, own in draft.sections["controllers"].items()}
    links = [
        f"{source}->{destination}" for source, destination, _ in links_between(listens, wiring, heard_by)
    ]
    placed, on_link = place(draft, kinds.attacks, kinds.channels, links)
    warn_of_mistaken_silence(draft, kinds, listens, placed)
    placed = granted(draft, placed, plant, sensors, listens)
    oracles = oracles_of(draft, grants, placed, listens)
    integrity = integrity_of(draft, placed)
    outlived = outlived_nodes(draft, [stage.plan for stage in placed])
    build_stages(draft, placed)
    state_groups = {str(name): tuple(indices) for name, indices in plant.state_groups.items()}
    expectations = read_expectations(draft, state_groups, links)
    draft.problems.stop_if_any()
    name = draft.sections["name"] or file.stem
    process = draft.sections["process"]
    stages = [stage.plan for stage in placed]
    return Topology(
        path=file,
        plan=make_plan(name, draft, kinds, listens, wiring, stages, on_link, integrity, oracles),
        state_groups=state_groups,
        expectations=expectations,
        score_options=draft.sections["score"],
        settings=RunSettings(process.window, process.stall_s, outlived),
        backend=process.backend,
        warnings=tuple(draft.warnings),
        document=resolved_document(
            name, draft.sections, kinds, listens, wiring, integrity, oracles, expectations
        ),
    )


def _refuse_idle(
    draft: Draft, listens: dict[str, list[str]], neighbours: dict[str, dict[str, float]]
) -> None:
    for name, sensors in listens.items():
        if not sensors and not neighbours[name]:
            cure = "give it 'sensors', or an edge of the graph"
            draft.complain(("estimators", name), f"{name} has neither a sensor nor a neighbour", cure)
