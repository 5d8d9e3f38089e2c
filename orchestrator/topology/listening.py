"""Which sensors each estimator listens to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from orchestrator.topology.draft import CheckedKind, Draft
from orchestrator.topology.names import select, split_number
from orchestrator.topology.problems import did_you_mean


def listeners(draft: Draft, kinds: Mapping[str, CheckedKind]) -> dict[str, list[str]]:
    """Return the sensors of each estimator of which the kind is known.

    Sensors stand in the order of their declaration, or in that of the patterns that the estimator lists.
    """
    sensors = draft.names("sensors")
    chosen = {}
    unpaired = []
    for name, checked in kinds.items():
        stated = _stated(draft, name)
        choice: object = getattr(checked.found.type, "listens", "paired") if stated is None else stated
        if choice == "all":
            chosen[name] = sensors
        elif choice == "paired" and sensors:
            chosen[name] = _paired(draft, name, sensors)
        elif choice == "paired":
            chosen[name] = []
            unpaired.append(name)
        else:
            chosen[name] = _selected(
                draft, name, [choice] if isinstance(choice, str) else list(stated or ()), sensors
            )
    if unpaired:
        cure = "add 'sensors', or 'sensors: []' to those that only listen to neighbours"
        message = f"there are no sensors for {unpaired[0]} to be paired with"
        draft.complain(("estimators", unpaired[0]), message, cure)
    return chosen


def _stated(draft: Draft, name: str) -> str | list[str] | None:
    """Return what the file says; an ill-typed value counts as nothing, for it was complained of already."""
    entry, _ = draft.root.nearest(("estimators", name))
    member = entry.mapping.get("sensors")
    stated = None if member is None else member.plain()
    if isinstance(stated, list):
        return [pattern for pattern in stated if isinstance(pattern, str)]
    return stated if isinstance(stated, str) else None


def _paired(draft: Draft, name: str, sensors: Sequence[str]) -> list[str]:
    _, number = split_number(name)
    paired = [sensor for sensor in sensors if number is not None and split_number(sensor)[1] == number]
    if not paired:
        wanted = "number" if number is None else f"sensor with number {number}"
        message = f"{name} has no {wanted} to be paired by"
        draft.complain(
            ("estimators", name),
            message,
            "give it 'sensors: [...]'; 'sensors: []' only listens to neighbours",
        )
    return paired


def _selected(draft: Draft, name: str, patterns: Sequence[str], sensors: Sequence[str]) -> list[str]:
    chosen: dict[str, None] = {}
    for pattern in patterns:
        found = select(pattern, sensors)
        if not found:
            path = ("estimators", name, "sensors")
            draft.complain(path, f"there is no sensor '{pattern}'", did_you_mean(pattern, sensors))
        chosen.update(dict.fromkeys(found))
    return list(chosen)


def warn_of_unheard(draft: Draft, chosen: Mapping[str, Sequence[str]]) -> None:
    """Warn of sensors that nobody listens to."""
    heard = {sensor for sensors in chosen.values() for sensor in sensors}
    for sensor in draft.names("sensors"):
        if sensor not in heard:
            draft.warn(
                ("sensors", sensor),
                f"nobody listens to {sensor}",
                "pair an estimator with it, or take it out",
            )
