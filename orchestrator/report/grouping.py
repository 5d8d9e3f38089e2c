"""From sources to the groups that a page tells apart: which estimators belong together, and their names."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from orchestrator.evidence.chosen import Chosen, told_apart
from orchestrator.evidence.columns import ColumnError, Rows, select
from orchestrator.evidence.price import find_twins
from orchestrator.evidence.sources import RESULTS
from orchestrator.report.errors import ReportError
from orchestrator.report.groups import Group, described, state_names, trial_rmse

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.parquet as pq

MOST = 40
"""Most groups that a page tells of."""

LISTED = 8
"""Most variants that a note names."""

_KEYS = ("variant", "trial", "seed", "node", "method", "status")
_EVENTS = ("packet.", "window.")

PACKETS = 4_000_000
"""Most judged packets that are read."""


def find_groups(chosen: Sequence[Chosen], by: str | None, notes: list[str]) -> list[Group]:
    """Return the groups of what was chosen, in their order.

    ``by`` says what estimators of a variant make a group: each alone (``node``), those of one ``method``, or
    all (``variant``, or the path that tells the variants apart). By default it is those that differ in
    nothing but what they hear.

    Raises
    ------
    InputError
        Nothing was scored, or the variants cannot be taken apart ``by`` that.
    """
    paths = list(dict.fromkeys(str(own.source.path) for own in chosen))
    names = [next(own.source.name for own in chosen if str(own.source.path) == path) for path in paths]
    titles = dict(zip(paths, told_apart(names, paths), strict=True)) if len(paths) > 1 else {}
    if by not in ("node", "method", None):
        for own in chosen:
            own.check_by(by)
    found = [
        group
        for number, own in enumerate(chosen)
        for group in _groups_of(own, number, titles.get(str(own.source.path), ""), by, notes)
    ]
    if not found:
        path = chosen[0].source.path
        raise ReportError(f"{path} holds no trial that was scored: there is nothing to report")
    if len(found) > MOST:
        notes.append(f"{MOST} of {len(found)} groups of estimators are reported, the first of them.")
        found = found[:MOST]
    return _placed(found)


def _placed(found: Sequence[Group]) -> list[Group]:
    """Return groups with what each is among the others: its number, name and rank, and if a twin."""
    called = [group.name for group in found]
    twins = _twins(found)
    ranks = {place: rank for rank, place in enumerate(_ranked(found, twins))}
    return [
        replace(
            group,
            name=group.name if called.count(group.name) == 1 else f"{group.name} [{number}]",
            number=number,
            is_twin=group.variant in twins,
            rank=ranks[number - 1],
        )
        for number, group in enumerate(found, start=1)
    ]


def _twins(groups: Sequence[Group]) -> set[tuple[int, int]]:
    """Return the variants that are others without their attacks, and held to what is expected of these."""
    documents = {group.variant: group.document for group in groups}
    attacked = [own for own in documents.values() if own.get("attacks")]
    return {
        variant
        for variant, own in documents.items()
        if not own.get("attacks")
        and any(own.get("expect") == hit.get("expect") and find_twins([hit, own]) for hit in attacked)
    }


def _ranked(groups: Sequence[Group], twins: Collection[tuple[int, int]]) -> list[int]:
    """Return the places of groups by how little they err, best first, twins last.

    A twin comes late because its curve is that of an attacked one until the attack begins.
    """
    state = state_names(groups)[0]

    def order(place: int) -> tuple[bool, float]:
        errors = trial_rmse(groups[place].rows, state)
        known = errors[~np.isnan(errors)]
        return groups[place].variant in twins, float(np.mean(known**2)) if known.size else np.inf

    return sorted(range(len(groups)), key=order)


def _groups_of(chosen: Chosen, number: int, title: str, by: str | None, notes: list[str]) -> list[Group]:
    source = chosen.source
    table = source.read(lambda name: not name.startswith("packet."), chosen.variants)
    judged, found = _judged(chosen, notes), []
    for variant, settings in _different(chosen, notes).items():
        try:
            whole = select(table, variant=variant)
        except ColumnError:
            continue
        document = source.document(variant)
        parts = _parts(whole, document, by)
        own_words = {
            path: word for path, word in described(chosen.variants[variant]).items() if path in settings
        }
        for part, nodes in parts.items():
            told = (title, *own_words.values())
            rows = select(table, variant=variant, nodes=nodes)
            found.append(
                Group(
                    name=", ".join(filter(None, (*told, part if len(parts) > 1 or not any(told) else ""))),
                    title=title,
                    settings=settings,
                    words=own_words,
                    part=part,
                    variant=(number, variant),
                    rows=rows,
                    judged=select(judged, variant=variant, nodes=nodes),
                    nodes=nodes,
                    attacked=_attacked(rows),
                    document=document,
                )
            )
    return found


def _different(chosen: Chosen, notes: list[str]) -> dict[int, Mapping[str, str]]:
    """Return the variants that ran different topologies, each with the settings that make it what it is.

    Where a setting changes nothing, as that of an attack in the twin without it, several variants ran the
    same, trial by trial: the first stands for all, under the settings that all of them share.
    """
    hashes = chosen.source.provenance.get("topology_hashes") or []
    alike: dict[Any, list[int]] = {}
    for variant in chosen.variants:
        alike.setdefault(hashes[variant] if variant < len(hashes) else variant, []).append(variant)
    repeated = [own for own in alike.values() if len(own) > 1]
    if repeated:
        told = "; ".join(f"{', '.join(map(str, more))} as {first}" for first, *more in repeated[:LISTED])
        count = sum(len(own) - 1 for own in repeated)
        notes.append(
            f"{count} of {len(chosen.variants)} variants ran the very topology of another one, in which what "
            f"sets them apart changes nothing, and are told of with it, by number: {told}"
            f"{'; ...' if len(repeated) > LISTED else ''}."
        )
    return {
        first: _shared([chosen.variants[own] for own in (first, *more)]) for first, *more in alike.values()
    }


def _shared(settings: Sequence[Mapping[str, str]]) -> dict[str, str]:
    """Return the settings that all have in common."""
    first, *others = settings
    return {path: own for path, own in first.items() if all(other[path] == own for other in others)}


def _judged(chosen: Chosen, notes: list[str]) -> pa.Table:
    """Return the rows with their judged packets: of the first trials only, where these are very many."""
    source = chosen.source
    if source.kind == "run":
        return source.table
    import pyarrow.parquet as pq

    file = source.path / RESULTS
    held = pq.ParquetFile(file)
    names = [name for name in held.schema_arrow.names if name in _KEYS or name.startswith(_EVENTS)]
    packets = _packets(held.metadata, chosen)
    some = ("variant", "in", sorted(chosen.variants))
    if packets <= PACKETS:
        return pq.read_table(file, columns=names, filters=[some])
    first, trials = int(source.provenance["first_trial"]), int(source.provenance["trials"])
    most = max(2, trials * PACKETS // packets)
    notes.append(
        f"Detection is told of the first {most} of {trials} trials: {packets:,} packets were judged."
    )
    return pq.read_table(file, columns=names, filters=[some, ("trial", "<", first + most)])


def _packets(held: pq.FileMetaData, chosen: Chosen) -> int:
    """Return how many judged packets the parts of a results file hold in which the chosen variants stand."""
    found = 0
    for group in (held.row_group(i) for i in range(held.num_row_groups)):
        columns = {group.column(i).path_in_schema: group.column(i) for i in range(group.num_columns)}
        span = columns["variant"].statistics
        if span is None or any(span.min <= variant <= span.max for variant in chosen.variants):
            found += sum(own.num_values for path, own in columns.items() if path.startswith("packet.step"))
    return found


def _parts(rows: Rows, document: Mapping[str, Any], by: str | None) -> dict[str, list[str]]:
    """Return the estimators of a variant that belong together, under a name for each."""
    method = dict(zip(rows.text("node"), rows.text("method"), strict=True))
    privileged = rows.privileged
    if by == "node":
        return {f"{node} PRIVILEGED" if node in privileged else node: [node] for node in method}
    if by not in ("method", None):
        return {"all estimators": list(method)}
    parts: dict[tuple[str, str], list[str]] = {}
    for node, kind in method.items():
        own = f"{kind} PRIVILEGED" if node in privileged else kind
        stated = (document.get("estimators") or {}).get(node) or {}
        differs = {key: value for key, value in stated.items() if key not in ("sensors", "weights")}
        key = own, "" if by == "method" else repr(sorted(differs.items(), key=lambda item: item[0]))
        parts.setdefault(key, []).append(node)
    methods = [own for own, _ in parts]
    return {
        own if methods.count(own) == 1 else f"{own} {_span(nodes)}": nodes
        for (own, _), nodes in parts.items()
    }


def _span(nodes: Sequence[str]) -> str:
    return nodes[0] if len(nodes) == 1 else f"{nodes[0]} to {nodes[-1]}"


def _attacked(rows: Rows) -> tuple[str, ...]:
    hit = np.nansum(rows.series("attacked"), axis=1) > 0
    nodes = rows.text("node")
    return tuple(dict.fromkeys(node for node, own in zip(nodes, hit, strict=True) if own))
