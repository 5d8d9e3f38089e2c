"""Back from a log: the topology of an experiment, without loading any of its classes."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from orchestrator.backends.contract import RunSettings
from orchestrator.registry import FoundKind, Role
from orchestrator.topology.document import Entry
from orchestrator.topology.draft import CheckedKind, Draft
from orchestrator.topology.expecting import read_expectations
from orchestrator.topology.placement import place
from orchestrator.topology.problems import Origin, PathKeys, Problems
from orchestrator.topology.resolve import Kinds, links_between, make_plan
from orchestrator.topology.resolved import Topology
from orchestrator.topology.schema import TopologyFile
from orchestrator.topology.stages import declared_attacks, declared_channels
from orchestrator.topology.triggers import declared_triggers
from orchestrator.topology.wiring import Wiring

LOGGED = Path("topology.json")


class _TrustedDraft(Draft):
    """A draft of a topology that was checked before it was logged: its kinds are taken as they stand."""

    def check_kind(
        self, role: Role, name: str, path: PathKeys, parameters_path: PathKeys, stated: Mapping[str, Any]
    ) -> CheckedKind:
        found = FoundKind(name, name.rpartition(":")[2], name, object)
        return CheckedKind(found, stated, stated)


def _draft_of(file: TopologyFile) -> _TrustedDraft:
    """Return a draft of a logged topology, in which its nodes' names can be looked up."""
    origin = Origin(LOGGED.name, 0, LOGGED.parent)
    sections = {key: getattr(file, key) for key in TopologyFile.model_fields}
    nodes: dict[str, Iterable[str]] = {
        "sensors": file.sensors,
        "estimators": file.estimators,
        "controllers": file.controllers,
    }
    root = Entry(
        {
            section: Entry(dict.fromkeys(names, Entry(None, origin)), origin)
            for section, names in nodes.items()
        },
        origin,
    )
    return _TrustedDraft(root, Problems(), sections=sections)


def _kinds_of(file: TopologyFile, draft: _TrustedDraft) -> Kinds:
    """Return the kinds of a logged topology, as they stand in it."""
    return Kinds(
        draft.check_kind("plants", file.plant.model, (), (), file.plant.parameters),
        {
            name: draft.check_kind("sensors", own.model, (), (), own.parameters)
            for name, own in file.sensors.items()
        },
        {
            name: draft.check_kind("estimators", own.method, (), (), own.parameters)
            for name, own in file.estimators.items()
        },
        {
            name: draft.check_kind("controllers", own.law, (), (), own.parameters)
            for name, own in file.controllers.items()
        },
        declared_attacks(draft),
        declared_channels(draft),
        declared_triggers(draft),
    )


def _neighbours_of(file: TopologyFile) -> dict[str, dict[str, float]]:
    """Return the in-neighbours of each estimator with their weights."""
    neighbours: dict[str, dict[str, float]] = {name: {} for name in file.estimators}
    for source, destination, weight in file.graph.edges if file.graph and file.graph.edges else ():
        neighbours[str(destination)][str(source)] = float(weight)
    return neighbours


def topology_from_experiment(experiment: bytes) -> Topology:
    """Return the topology that `Topology.experiment_json` wrote.

    Its plan names each kind as the topology does and holds plain parameters: it tells everything about a run,
    and is not for running. Nothing of the user's own code is loaded. Raises ValueError when the JSON is
    something else.
    """
    content = json.loads(experiment)
    file = TopologyFile.model_validate_json(json.dumps(content["topology"]))
    draft = _draft_of(file)
    listens = {name: list(own.sensors or ()) for name, own in file.estimators.items()}
    wiring = Wiring(_neighbours_of(file), content["rounds"])
    kinds = _kinds_of(file, draft)
    heard_by = {name: own.estimator for name, own in file.controllers.items()}
    links = [
        f"{source}->{destination}" for source, destination, _ in links_between(listens, wiring, heard_by)
    ]
    placed, on_link = place(draft, kinds.attacks, kinds.channels, links)
    state_groups = {name: tuple(indices) for name, indices in content["state_groups"].items()}
    return Topology(
        path=LOGGED,
        plan=make_plan(
            str(file.name),
            draft,
            kinds,
            listens,
            wiring,
            [stage.plan for stage in placed],
            on_link,
            file.integrity,
        ),
        state_groups=state_groups,
        expectations=read_expectations(draft, state_groups, links),
        score_options=file.score,
        settings=RunSettings(),
        backend="processes",
        warnings=(),
        document=content["topology"],
    )
