"""The resolved topology: everything explicit, in the same schema, and the plan that it makes."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from bus.keys import CONTROL, EXCHANGE, MEASUREMENT
from bus.plan import (
    ControllerPlan,
    EstimatorPlan,
    Kind,
    LinkPlan,
    Plan,
    PlantPlan,
    SensorPlan,
    StagePlan,
)
from orchestrator.registry import portable_name
from orchestrator.score.expectation import Expectation
from orchestrator.topology.draft import CheckedKind, Draft
from orchestrator.topology.placement import fault_plans, signal_plans
from orchestrator.topology.stages import DeclaredStage
from orchestrator.topology.targets import PLANT_NAME
from orchestrator.topology.wiring import Wiring


@dataclasses.dataclass(frozen=True)
class Kinds:
    """The checked kinds of a topology."""

    plant: CheckedKind | None
    sensors: Mapping[str, CheckedKind]
    estimators: Mapping[str, CheckedKind]
    controllers: Mapping[str, CheckedKind]
    attacks: Sequence[DeclaredStage]
    channels: Sequence[DeclaredStage]
    triggers: Mapping[str, CheckedKind]
    """Event triggers by the node that they belong to."""

    def sending(self, node: str) -> Kind | None:
        """Return the kind of a node's event trigger as a plan holds it; None when it always sends."""
        checked = self.triggers.get(node)
        return None if checked is None else checked.kind


def links_between(
    listens: Mapping[str, Sequence[str]], wiring: Wiring, heard_by: Mapping[str, str]
) -> list[tuple[str, str, str]]:
    """Return every link (source, destination, stream): measurements first, receiver by receiver.

    ``heard_by`` gives the estimator of each controller.
    """
    measured = [(sensor, name, MEASUREMENT) for name, sensors in listens.items() for sensor in sensors]
    exchanged = [
        (source, name, EXCHANGE) for name, sources in wiring.neighbours.items() for source in sources
    ]
    commanded = [
        (controller, receiver, CONTROL)
        for controller, estimator in heard_by.items()
        for receiver in (PLANT_NAME, estimator)
    ]
    return measured + exchanged + commanded


def make_plan(
    name: str,
    draft: Draft,
    kinds: Kinds,
    listens: Mapping[str, Sequence[str]],
    wiring: Wiring,
    stages: Sequence[StagePlan],
    on_link: Mapping[str, tuple[str, ...]],
    integrity: Mapping[str, str],
) -> Plan:
    """Return the plan of a topology that is in order."""
    assert kinds.plant is not None
    sections = draft.sections
    heard_by = {name: own.estimator for name, own in sections["controllers"].items()}
    return Plan(
        name=name,
        seed=sections["seed"],
        trial=sections["trial"],
        steps=sections["steps"],
        period_s=sections["period_s"],
        plant=PlantPlan(PLANT_NAME, kinds.plant.kind, tuple(heard_by)),
        sensors=tuple(
            SensorPlan(sensor, checked.kind, kinds.sending(sensor))
            for sensor, checked in kinds.sensors.items()
        ),
        estimators=tuple(
            EstimatorPlan(
                estimator,
                checked.kind,
                tuple(listens[estimator]),
                wiring.neighbours[estimator],
                wiring.rounds[estimator],
                tuple(name for name, heard in heard_by.items() if heard == estimator),
                kinds.sending(estimator),
            )
            for estimator, checked in kinds.estimators.items()
        ),
        stages=tuple(stages),
        links=tuple(
            LinkPlan(source, destination, stream, on_link[f"{source}->{destination}"])
            for source, destination, stream in links_between(listens, wiring, heard_by)
        ),
        controllers=tuple(
            ControllerPlan(name, checked.kind, heard_by[name]) for name, checked in kinds.controllers.items()
        ),
        signals=tuple(signal_plans(kinds.attacks)),
        faults=tuple(fault_plans(draft, kinds.attacks)),
        integrity=integrity,
    )


def resolved_document(
    name: str,
    sections: Mapping[str, Any],
    kinds: Kinds,
    listens: Mapping[str, Sequence[str]],
    wiring: Wiring,
    integrity: Mapping[str, str],
    expectations: Sequence[Expectation],
) -> dict[str, Any]:
    """Return the topology as plain data with nothing left to defaults, bases, ranges or generators."""
    assert kinds.plant is not None
    return {
        "name": name,
        "description": sections["description"],
        "seed": sections["seed"],
        "trial": sections["trial"],
        "period_s": sections["period_s"],
        "steps": sections["steps"],
        "plant": {"model": kinds.plant.found.name, **kinds.plant.plain},
        "sensors": {
            node: {"model": kind.found.name, **_send(kinds, node), **kind.plain}
            for node, kind in kinds.sensors.items()
        },
        "estimators": {
            node: {
                "method": kind.found.name,
                "sensors": list(listens[node]),
                **_send(kinds, node),
                **kind.plain,
            }
            for node, kind in kinds.estimators.items()
        },
        "controllers": {
            node: {"law": kind.found.name, "estimator": sections["controllers"][node].estimator, **kind.plain}
            for node, kind in kinds.controllers.items()
        },
        "graph": {
            "edges": [
                [source, node, weight]
                for node, sources in wiring.neighbours.items()
                for source, weight in sources.items()
            ],
            "directed": True,
        },
        "channel": _channels(sections["channel"], kinds.channels),
        "attacks": [_attack(stage) for stage in kinds.attacks],
        "adversary": sections["adversary"].model_dump(mode="json"),
        "integrity": dict(integrity),
        "expect": _expectations(expectations),
        "score": dataclasses.asdict(sections["score"]),
        "process": sections["process"].model_dump(mode="json"),
    }


def _send(kinds: Kinds, node: str) -> dict[str, Any]:
    """Return the member that states a node's event trigger, if it has one."""
    trigger = kinds.triggers.get(node)
    return {} if trigger is None else {"send": {trigger.found.name: dict(trigger.plain)}}


def _options(stage: DeclaredStage) -> dict[str, Any]:
    """Return a stage's own options; its scope is stated unless the stream says who shares."""
    stated = {"name": stage.name, "stream": stage.stream}
    options = {key: value for key, value in stated.items() if value is not None}
    return options if stage.stream is not None else {"scope": stage.scope, **options}


def _channels(patterns: Iterable[str], stages: Sequence[DeclaredStage]) -> dict[str, list[dict[str, Any]]]:
    channels: dict[str, list[dict[str, Any]]] = {pattern: [] for pattern in patterns}
    for stage in stages:
        inside = {**stage.checked.plain, **_options(stage)}
        channels[stage.on[0]].append({stage.checked.found.name: inside})
    return channels


def _attack(stage: DeclaredStage) -> dict[str, Any]:
    windows = [list(window) for window in stage.windows]
    when = {} if stage.when is None else {"when": {stage.when.found.name: dict(stage.when.plain)}}
    return {
        stage.checked.found.name: dict(stage.checked.plain),
        "on": list(stage.on),
        "steps": windows,
        **when,
        **_options(stage),
    }


def _expectations(expectations: Sequence[Expectation]) -> dict[str, list[dict[str, Any]]]:
    found: dict[str, list[dict[str, Any]]] = {}
    for expectation in expectations:
        stated = {
            "node": list(expectation.nodes) or None,
            "link": list(expectation.links) or None,
            "at_most": expectation.at_most,
            "at_least": expectation.at_least,
            "equals": expectation.equals,
        }
        limit = {key: value for key, value in stated.items() if value is not None}
        found.setdefault(expectation.metric, []).append(limit)
    return found


def experiment_document(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return what of a resolved topology is the experiment: no prose, no process settings, no paths.

    A user's file is named by the hash of its content: the same code is the same experiment wherever it lies.
    """
    experiment = {key: value for key, value in document.items() if key not in ("description", "process")}
    experiment["plant"] = _portable(experiment["plant"], "model")
    experiment["sensors"] = {node: _portable(own, "model") for node, own in experiment["sensors"].items()}
    experiment["estimators"] = {
        node: _portable(own, "method") for node, own in experiment["estimators"].items()
    }
    experiment["controllers"] = {
        node: _portable(own, "law") for node, own in experiment["controllers"].items()
    }
    experiment["channel"] = {
        pattern: [_portable_keys(stage) for stage in stages]
        for pattern, stages in experiment["channel"].items()
    }
    experiment["attacks"] = [_portable_keys(attack) for attack in experiment["attacks"]]
    return experiment


def _portable(node: Mapping[str, Any], kind_key: str) -> dict[str, Any]:
    portable = {**node, kind_key: portable_name(node[kind_key])}
    if "send" in portable:
        portable["send"] = {portable_name(key): value for key, value in portable["send"].items()}
    return portable


def _portable_keys(stage: Mapping[str, Any]) -> dict[str, Any]:
    portable = {portable_name(key): value for key, value in stage.items()}
    if "when" in portable:
        portable["when"] = {portable_name(key): value for key, value in portable["when"].items()}
    return portable
