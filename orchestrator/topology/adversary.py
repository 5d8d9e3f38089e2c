"""What the adversary is granted to know, and how senders seal their packets against it."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from nodes.contract import Plant, Sensor
from orchestrator.topology.draft import Draft
from orchestrator.topology.knowledge import KnowledgeError, knowledge
from orchestrator.topology.names import matches
from orchestrator.topology.placement import PlacedStage
from orchestrator.topology.targets import ARROW, PLANT_NAME, senders


def granted(
    draft: Draft,
    placed: Sequence[PlacedStage],
    plant: Plant,
    sensors: Mapping[str, Sensor],
    listens: Mapping[str, Sequence[str]],
) -> list[PlacedStage]:
    """Return the stages with what they know; those that need more than is granted are complained of.

    A kind says with its attribute ``needs`` what it needs of ``model`` and ``innovations``, and with
    ``needs_control_link`` that it acts on the plant's input.
    """
    knows = frozenset(draft.sections["adversary"].knows)
    told = _told(draft, plant, sensors, listens, knows)
    return [_with_knowledge(draft, stage, knows, told) for stage in placed]


def _told(
    draft: Draft,
    plant: Plant,
    sensors: Mapping[str, Sensor],
    listens: Mapping[str, Sequence[str]],
    knows: frozenset[str],
) -> dict[str, Any]:
    try:
        return knowledge(plant, sensors, listens, knows)
    except KnowledgeError as error:
        draft.complain(("adversary", "knows"), str(error))
        return {}


def _with_knowledge(
    draft: Draft, stage: PlacedStage, knows: frozenset[str], told: Mapping[str, Any]
) -> PlacedStage:
    found = stage.declared.checked.found
    needs: frozenset[str] = getattr(found.type, "needs", frozenset())
    path = stage.declared.path
    if needs - knows:
        listed = ", ".join(sorted(knows | needs))
        message = f"{found.short_name} needs to know: {', '.join(sorted(needs - knows))}"
        draft.complain(path, message, f"grant it with 'adversary: {{knows: [{listed}]}}'")
    on_control = any(link.partition(ARROW)[2] == PLANT_NAME for link in stage.plan.streams)
    if getattr(found.type, "needs_control_link", False) and not on_control:
        cure = "give the plant a controller, and the attack its link, such as 'on: [c1->plant, s*->e1]'"
        draft.complain(
            path, f"{found.short_name} acts on the plant's input, and no such link is attacked", cure
        )
    if stage.declared.role != "attack":
        return stage
    mine = told if needs else {}
    plan = dataclasses.replace(stage.plan, knowledge=mine, holds_keys="keys" in knows)
    return dataclasses.replace(stage, plan=plan)


def integrity_of(draft: Draft, placed: Sequence[PlacedStage]) -> dict[str, str]:
    """Return how each sender seals its packets: as stated (the last pattern holds), or as its links ask for.

    A kind that damages packets says with its attribute ``default_integrity`` what senders on its links use
    when the topology says nothing.
    """
    found: dict[str, str] = {}
    for stage in placed:
        default = getattr(stage.declared.checked.found.type, "default_integrity", None)
        if default is not None:
            found.update({link.partition(ARROW)[0]: default for link in stage.plan.streams})
    for pattern, integrity in draft.sections["integrity"].items():
        found.update({name: integrity for name in senders(draft) if matches(pattern, name)})
    return {name: found[name] for name in senders(draft) if found.get(name, "none") != "none"}
