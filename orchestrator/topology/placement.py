"""From declared stages to stages on links, and the addresses of their random streams.

On every link the attacks act first, in the order of the file, and then the stages of the link's channel: an
adversary falsifies what is sent, and the network may still lose it. A link has one channel: the last
pattern that fits it.

A stage draws from the address (stream, purpose). The purpose is its ``name``, or that of its kind. The
stream is, link by link, the link's own name, or one name for all links of a shared stage. When two stages
would so have the same address, the second one's streams end in ``#2``; streams that the topology states
itself are left alone, so they can be shared.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from bus.plan import FaultPlan, SignalPlan, StagePlan, TimingPlan
from orchestrator.topology.draft import Draft
from orchestrator.topology.names import matches
from orchestrator.topology.problems import PathKeys
from orchestrator.topology.stages import DeclaredStage
from orchestrator.topology.targets import PLANT_NAME, as_link_pattern, links_of_pattern, senders


@dataclass(frozen=True)
class PlacedStage:
    """A stage of a plan and the declaration that it comes from."""

    plan: StagePlan
    declared: DeclaredStage


class _Addresses:
    """Hands out labels and streams; a second use of one is told from the first by a number."""

    def __init__(self) -> None:
        self._streams: dict[tuple[str, str], int] = {}
        self._labels: dict[str, int] = {}

    def streams(self, stage: DeclaredStage, links: Sequence[str]) -> dict[str, str]:
        streams = {link: stage.stream_of(link) for link in links}
        if stage.stream is not None:
            return streams
        for name in dict.fromkeys(streams.values()):
            address = name, stage.purpose
            self._streams[address] = self._streams.get(address, 0) + 1
        return {link: _numbered(name, self._streams[name, stage.purpose]) for link, name in streams.items()}

    def label(self, stage: DeclaredStage) -> str:
        label = stage.name or f"{stage.checked.found.short_name}@{','.join(stage.on)}"
        self._labels[label] = self._labels.get(label, 0) + 1
        return _numbered(label, self._labels[label])


def _numbered(name: str, occurrence: int) -> str:
    return name if occurrence == 1 else f"{name}#{occurrence}"


def place(
    draft: Draft, attacks: Sequence[DeclaredStage], channels: Sequence[DeclaredStage], links: Sequence[str]
) -> tuple[list[PlacedStage], dict[str, tuple[str, ...]]]:
    """Return the placed stages, and the labels of those on each link in the order in which they act."""
    channel_of = _channels_of_links(draft, links)
    addresses = _Addresses()
    placed: list[PlacedStage] = []
    on_link: dict[str, list[str]] = {link: [] for link in links}
    _refuse_unlike_sharers(draft, [*attacks, *channels], links)
    for stage in (*(stage for stage in attacks if stage.role == "attack"), *channels):
        if stage.role == "attack":
            mine = _attacked_links(draft, stage, links)
        else:
            mine = [link for link in links if channel_of.get(link) == stage.on[0]]
        for plan in _plans(stage, mine, addresses):
            placed.append(PlacedStage(plan, stage))
            for link in mine:
                on_link[link].append(plan.label)
    return placed, {link: tuple(labels) for link, labels in on_link.items()}


def _refuse_unlike_sharers(draft: Draft, stages: Sequence[DeclaredStage], links: Sequence[str]) -> None:
    """Note stages that state the stream of another one of their kind, and other parameters."""
    owners: dict[tuple[str, str], DeclaredStage] = {}
    for stage in stages:
        if stage.stream is None:
            continue
        mine = {link for pattern in stage.on for link in links_of_pattern(pattern, links)}
        for stream in sorted({stage.stream_of(link) for link in mine}):
            owner = owners.setdefault((stream, stage.purpose), stage)
            if owner.checked.plain != stage.checked.plain:
                draft.complain(
                    (*stage.path, "stream"),
                    f"two unlike chains of {stage.checked.found.short_name} share the stream '{stream}'",
                    "give both the same parameters, or one of them another stream or a 'name' of its own",
                )
                break


def _plans(stage: DeclaredStage, links: Sequence[str], addresses: _Addresses) -> Iterator[StagePlan]:
    """Yield one plan for each window, each with draws of its own; none when no link is left to the stage."""
    if not links:
        return
    streams, label = addresses.streams(stage, links), addresses.label(stage)
    for number, (first, last) in enumerate(stage.windows, start=1):
        suffix = f"/{number}" if number > 1 else ""
        timing = timing_of(stage, first, last, label, suffix)
        yield StagePlan(label + suffix, stage.checked.kind, streams, stage.purpose + suffix, timing)


def timing_of(stage: DeclaredStage, first: int, last: int, label: str, suffix: str = "") -> TimingPlan:
    """Return when a stage acts in one of its windows; its links share the draws of its schedule."""
    if stage.when is None:
        return TimingPlan(first, last)
    watches = getattr(stage.when.found.type, "watches", None)
    return TimingPlan(
        first,
        last,
        stage.when.kind,
        stream=stage.stream or label,
        purpose=f"{stage.purpose}{suffix}/when",
        watches="" if watches is None else watches(stage.when.parameters, PLANT_NAME),
    )


def signal_plans(attacks: Sequence[DeclaredStage]) -> list[SignalPlan]:
    """Return the signals that enter plant and sensors, one for each window."""
    addresses = _Addresses()
    plans = []
    for stage in attacks:
        if stage.role == "signal":
            label = addresses.label(stage)
            for number, (first, last) in enumerate(stage.windows, start=1):
                suffix = f"/{number}" if number > 1 else ""
                timing = timing_of(stage, first, last, label, suffix)
                plans.append(SignalPlan(label + suffix, stage.checked.kind, stage.purpose + suffix, timing))
    return plans


def fault_plans(draft: Draft, attacks: Sequence[DeclaredStage]) -> list[FaultPlan]:
    """Return the scheduled ends of nodes."""
    names = senders(draft)
    return [
        FaultPlan(name, stage.checked.found.name, stage.windows[0][0])
        for stage in attacks
        if stage.role == "fault"
        for name in names
        if any(matches(pattern, name) for pattern in stage.on)
    ]


def _channels_of_links(draft: Draft, links: Sequence[str]) -> dict[str, str]:
    """Return the pattern that holds for each link: the last one that fits."""
    holds: dict[str, str] = {}
    fitting = {pattern: links_of_pattern(pattern, links) for pattern in draft.sections["channel"]}
    for pattern, found in fitting.items():
        if not found:
            _complain_of_no_link(draft, pattern, ("channel", pattern), links)
        holds.update(dict.fromkeys(found, pattern))
    left = set(holds.values())
    for pattern, found in fitting.items():
        if found and pattern not in left:
            message = f"no link is left to '{pattern}': later patterns fit all of its links"
            draft.warn(
                ("channel", pattern),
                message,
                "the last pattern that fits a link holds: put special cases last",
            )
    return holds


def _attacked_links(draft: Draft, stage: DeclaredStage, links: Sequence[str]) -> list[str]:
    chosen: set[str] = set()
    for index, pattern in enumerate(stage.on):
        found = links_of_pattern(pattern, links)
        if not found:
            _complain_of_no_link(draft, pattern, (*stage.path, "on", index), links)
        chosen.update(found)
    return [link for link in links if link in chosen]


def _complain_of_no_link(draft: Draft, pattern: str, path: PathKeys, links: Sequence[str]) -> None:
    _, _, right = as_link_pattern(pattern).partition("->")
    into = [link for link in links if matches(right, link.partition("->")[2])]
    shown = ", ".join(into[:8]) + (", ..." if len(into) > 8 else "")
    draft.complain(path, f"there is no link {pattern}", f"into {right} lead: {shown}" if into else "")
