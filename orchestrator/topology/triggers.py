"""Event triggers as a topology declares them: ``send: {kind: {...}}`` of a sensor or an estimator."""

from __future__ import annotations

import functools
from collections.abc import Mapping

from bus.random_streams import random_stream
from nodes.contract import Plant, Sensor
from nodes.triggers.contract import TriggerSetting
from orchestrator.topology.construction import tried
from orchestrator.topology.draft import CheckedKind, Draft
from orchestrator.topology.problems import PathKeys
from orchestrator.topology.resolve import Kinds
from orchestrator.topology.wiring import Wiring

_EXTERNAL = "nodes.estimators.external:External"


def declared_triggers(draft: Draft) -> dict[str, CheckedKind]:
    """Return the event triggers that are in order, by the node that they belong to."""
    found: dict[str, CheckedKind] = {}
    for section in ("sensors", "estimators"):
        for name, own in (draft.sections.get(section) or {}).items():
            if own.send is None:
                continue
            checked = _declared(draft, own.send, (section, name, "send"))
            if checked is not None:
                found[name] = checked
    return found


def _declared(draft: Draft, send: Mapping[str, object], path: PathKeys) -> CheckedKind | None:
    if len(send) != 1:
        listed = ", ".join(send) or "none"
        cure = "for example {send_on_delta: {threshold: 0.1}}"
        draft.complain(path, f"'send' has exactly one event trigger, here: {listed}", cure)
        return None
    ((kind, stated),) = send.items()
    stated = {} if stated is None else stated
    place = (*path, kind)
    if not isinstance(stated, dict):
        draft.complain(place, f"the parameters of {kind} are not a mapping", f"write '{kind}: {{...}}'")
        return None
    return draft.check_kind("triggers", kind, place, place, stated)


def build_triggers(
    draft: Draft, triggers: Mapping[str, CheckedKind], plant: Plant, sensors: Mapping[str, Sensor]
) -> None:
    """Note what the classes of the event triggers refuse."""
    seed, trial = draft.sections["seed"], draft.sections["trial"]
    for name, checked in triggers.items():
        setting = TriggerSetting(name, plant, sensors.get(name), random_stream(seed, trial, name, "trigger"))
        build = functools.partial(checked.found.type, setting, **checked.parameters)
        section = "sensors" if name in sensors else "estimators"
        tried(draft, (section, name, "send"), f"trigger {checked.found.short_name}", build)


def check_senders(draft: Draft, kinds: Kinds, wiring: Wiring) -> None:
    """Note event triggers of estimators that send to nobody, or whose sending is not ours to decide."""
    heard = {source for sources in wiring.neighbours.values() for source in sources}
    for name in kinds.triggers:
        checked = kinds.estimators.get(name)
        if checked is None:
            continue
        path = ("estimators", name, "send")
        if checked.found.reference == _EXTERNAL:
            draft.complain(path, f"{name} is a program of its own and decides itself", "take 'send' out")
        elif name not in heard:
            cure = "take 'send' out, or give it a method that exchanges, and an edge of the graph"
            draft.complain(path, f"{name} sends to no neighbour", cure)
