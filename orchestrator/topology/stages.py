"""Attacks and channels as a topology declares them: a kind, patterns of links, windows, stream options."""

from __future__ import annotations

import itertools
import string
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

from bus.kinds import KindError
from orchestrator.log.errors import LogError
from orchestrator.registry import Role, UnknownKindError, find_kind
from orchestrator.topology.draft import CheckedKind, Draft
from orchestrator.topology.names import split_number
from orchestrator.topology.problems import PathKeys, did_you_mean
from orchestrator.topology.schema import AttackSection, Scope

STAGE_OPTIONS = ("name", "scope", "stream")
SERIES_PARAMETERS = ("values", "series")
"""Parameters that may be the place of a series (`orchestrator.topology.series`) instead of its rows."""
PLACEHOLDERS = frozenset({"link", "source", "destination", "source_number", "destination_number"})

Window = tuple[int, int]
StageRole = Literal["attack", "channel", "signal", "fault"]


@dataclass(frozen=True)
class DeclaredStage:
    """One declared stage: ``on`` says where, ``windows`` are its windows of steps, both ends inclusive.

    ``on`` are link patterns, of a signal the plant, and of a fault patterns of nodes. ``when`` is the
    schedule inside the windows.
    """

    role: StageRole
    checked: CheckedKind
    on: tuple[str, ...]
    windows: tuple[Window, ...]
    name: str | None
    scope: Scope
    stream: str | None
    path: PathKeys
    when: CheckedKind | None = None

    @property
    def purpose(self) -> str:
        """What its draws are for."""
        return f"{self.role}/{self.name or self.checked.found.short_name}"

    def stream_of(self, link: str) -> str:
        """Return the name of a link's random stream."""
        if self.stream is None:
            return ",".join(self.on) if self.scope == "shared" else link
        source, _, destination = link.partition("->")
        numbers = [split_number(name)[1] for name in (source, destination)]
        return self.stream.format(
            link=link,
            source=source,
            destination=destination,
            source_number=numbers[0],
            destination_number=numbers[1],
        )


_STAGE_ROLES: Mapping[Role, StageRole] = {"signals": "signal", "faults": "fault"}


def declared_attacks(draft: Draft) -> list[DeclaredStage]:
    """Return the attacks on links, plant and nodes that are in order, in the order of the file."""
    attacks: list[AttackSection] = draft.sections.get("attacks") or []
    found = (_attack(draft, section, ("attacks", index)) for index, section in enumerate(attacks))
    return [stage for stage in found if stage is not None]


def _attack(draft: Draft, section: AttackSection, path: PathKeys) -> DeclaredStage | None:
    if len(section.parameters) != 1:
        listed = ", ".join(section.parameters) or "none"
        draft.complain(
            path,
            f"an attack has exactly one kind, here: {listed}",
            "for example {bias: {value: 15}, on: s4->e4}",
        )
        return None
    ((kind, stated),) = section.parameters.items()
    windows = _windows(draft, section, path)
    others: tuple[Role, ...] = ("signals", "faults", "impairments")
    registry_role: Role = next((role for role in others if _is_registered(draft, role, kind)), "attacks")
    checked = _stage_kind(draft, kind, stated, path, registry_role)
    when, fits = _schedule(draft, section, path)
    if checked is None or windows is None or not fits:
        return None
    on = (section.on,) if isinstance(section.on, str) else tuple(section.on)
    scope = section.scope or "per_link"
    _check_stream(draft, section.stream, section.scope, path)
    role = _STAGE_ROLES.get(registry_role, "attack")
    return DeclaredStage(role, checked, on, windows, section.name, scope, section.stream, path, when)


def _schedule(draft: Draft, section: AttackSection, path: PathKeys) -> tuple[CheckedKind | None, bool]:
    """Return the schedule inside an attack's windows, and whether it is in order; what is wrong is noted."""
    if section.when is None:
        return None, True
    path = (*path, "when")
    if len(section.when) != 1:
        listed = ", ".join(section.when) or "none"
        cure = "for example {periodic: {every: 20, steps_on: 5}}"
        draft.complain(path, f"'when' has exactly one schedule, here: {listed}", cure)
        return None, False
    ((kind, stated),) = section.when.items()
    checked = _stage_kind(draft, kind, stated, path, "schedules")
    return checked, checked is not None


def _windows(draft: Draft, section: AttackSection, path: PathKeys) -> tuple[Window, ...] | None:
    """Return the windows, None when one of them is wrong (noted)."""
    steps: int | None = draft.sections.get("steps")
    if section.steps is None:
        return ((0, (steps or 1) - 1),)
    path = (*path, "steps")
    rows = [row for row in section.steps if isinstance(row, list)]
    rows = rows or [[number for number in section.steps if isinstance(number, int)]]
    faults = [fault for row in rows if (fault := _window_fault(row, steps))]
    ordered = sorted(rows)
    faults += [
        (f"the windows {a} and {b} overlap", "join them")
        for a, b in itertools.pairwise(ordered)
        if not faults and b[0] <= a[1]
    ]
    for message, cure in faults:
        draft.complain(path, message, cure)
    return None if faults else tuple((row[0], row[1]) for row in rows)


def _window_fault(row: Sequence[int], steps: int | None) -> tuple[str, str] | None:
    if len(row) != 2:
        return f"{list(row)} is not a window", "write [first, last], both inclusive: [90, 95]"
    first, last = row
    if last < first:
        return f"the window [{first}, {last}] runs backwards", f"write [{last}, {first}]"
    if first < 0 or (steps is not None and last >= steps):
        end = "" if steps is None else f"; steps run from 0 to {steps - 1}"
        return f"the window [{first}, {last}] leaves the run", f"both ends are inclusive{end}"
    return None


def declared_channels(draft: Draft) -> list[DeclaredStage]:
    """Return the stages of all channels that are in order, in the order of the file."""
    channel: Mapping[str, Sequence[Any]] = draft.sections.get("channel") or {}
    found = []
    for pattern, stages in channel.items():
        is_list = isinstance(draft.root.nearest(("channel", pattern))[0].value, tuple)
        for index, stage in enumerate(stages):
            path: PathKeys = ("channel", pattern, index) if is_list else ("channel", pattern)
            declared = _channel_stage(draft, pattern, stage, path)
            if declared is not None:
                found.append(declared)
    return found


def _channel_stage(
    draft: Draft, pattern: str, stage: str | Mapping[str, Any], path: PathKeys
) -> DeclaredStage | None:
    members = {stage: None} if isinstance(stage, str) else stage
    misplaced = [key for key in members if key in STAGE_OPTIONS]
    if misplaced or len(members) != 1:
        listed = ", ".join(members) or "none"
        cure = "write '- {gilbert_elliott: {failure: 0.1, recovery: 0.9, scope: shared}}', one stage an item"
        draft.complain(path, f"a stage has exactly one kind, and all else inside it; here: {listed}", cure)
        return None
    ((kind, inside),) = members.items()
    inside = {} if inside is None else inside
    options = {key: value for key, value in _members(inside) if key in STAGE_OPTIONS}
    stated = {key: value for key, value in _members(inside) if key not in STAGE_OPTIONS}
    checked = _stage_kind(draft, kind, stated if isinstance(inside, dict) else inside, path, "impairments")
    if not _options_fit(draft, options, (*path, kind)) or checked is None:
        return None
    last = (draft.sections.get("steps") or 1) - 1
    scope: Scope = options.get("scope") or "per_link"
    _check_stream(draft, options.get("stream"), options.get("scope"), (*path, kind))
    return DeclaredStage(
        "channel", checked, (pattern,), ((0, last),), options.get("name"), scope, options.get("stream"), path
    )


def _members(value: Any) -> list[tuple[str, Any]]:
    return list(value.items()) if isinstance(value, dict) else []


def _options_fit(draft: Draft, options: Mapping[str, Any], path: PathKeys) -> bool:
    fits = True
    for key, value in options.items():
        if key == "scope" and value not in ("per_link", "shared", None):
            cure = did_you_mean(str(value), get_args(Scope))
            draft.complain((*path, key), f"{value!r} is not 'per_link' or 'shared'", cure)
            fits = False
        elif key != "scope" and not (value is None or (isinstance(value, str) and value)):
            draft.complain((*path, key), f"{value!r} is not text", "give a name")
            fits = False
    return fits


def _check_stream(draft: Draft, stream: str | None, scope: str | None, path: PathKeys) -> None:
    if stream is None:
        return
    if scope is not None:
        draft.complain((*path, "stream"), "'stream' and 'scope' exclude each other", "keep 'stream'")
    try:
        used = {field for _, field, _, _ in string.Formatter().parse(stream) if field is not None}
    except ValueError:
        used = {stream}
    if not used <= PLACEHOLDERS:
        listed = ", ".join(f"{{{name}}}" for name in sorted(PLACEHOLDERS))
        draft.complain((*path, "stream"), f"'{stream}' has an unknown placeholder", f"there is: {listed}")


def _stage_kind(draft: Draft, kind: str, stated: Any, path: PathKeys, role: Role) -> CheckedKind | None:
    """Return the kind of a stage. An impairment may serve as an attack, not the other way round."""
    place = (*path, kind)
    stated = {} if stated is None else stated
    if not isinstance(stated, dict):
        draft.complain(place, f"the parameters of {kind} are not a mapping", f"write '{kind}: {{...}}'")
        return None
    stated = _with_series(draft, stated, place)
    if path[0] == "channel" and _is_registered(draft, "attacks", kind):
        draft.complain(place, f"{kind} is an attack", "state it under 'attacks', with 'on' and 'steps'")
        return None
    return draft.check_kind(role, kind, place, place, stated)


def _with_series(draft: Draft, stated: dict[str, Any], place: PathKeys) -> dict[str, Any]:
    """Return parameters in which the place of a series is replaced by its rows; what is wrong is noted."""
    found = dict(stated)
    for key in SERIES_PARAMETERS:
        if not isinstance(stated.get(key), str):
            continue
        from orchestrator.topology.series import SeriesError, read_series

        entry, _ = draft.root.nearest((*place, key))
        try:
            found[key] = read_series(str(entry.origin.directory / stated[key]))
        except (SeriesError, LogError) as error:
            draft.complain((*place, key), str(error))
            found[key] = []
    return found


def _is_registered(draft: Draft, role: Role, kind: str) -> bool:
    if ":" in kind:
        return False
    try:
        find_kind(role, kind, draft.root.origin.directory)
    except UnknownKindError:
        return False
    except KindError:
        pass
    return True


def refuse_repeated_names(draft: Draft, stages: Sequence[DeclaredStage]) -> None:
    """Note stages that were given the name of another."""
    taken: set[str] = set()
    for stage in stages:
        if stage.name is not None and stage.name in taken:
            draft.complain(
                (*stage.path, "name"), f"the name '{stage.name}' is taken", "give each stage its own"
            )
        taken.add(stage.name or "")
