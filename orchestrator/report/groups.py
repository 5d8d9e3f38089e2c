"""What a page of many trials tells apart: estimators of one kind in one variant of one source."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from orchestrator.evidence.bootstrap import CONFIDENCE
from orchestrator.evidence.columns import ColumnError, Rows, select, state_groups
from orchestrator.evidence.sources import RESULTS, Source
from orchestrator.evidence.table import settings_by_variant
from orchestrator.report.errors import ReportError
from orchestrator.score.gather import Bools, Floats

if TYPE_CHECKING:
    import pyarrow as pa

ALL, ATTACKED = "all", "attacked"
By = Literal["node", "method", "variant"]

MOST = 40
"""Most groups that a page tells of."""

_KEYS = ("variant", "trial", "seed", "node", "method", "status")
_EVENTS = ("packet.", "window.")

PACKETS = 4_000_000
"""Most judged packets that are read."""


@dataclass(frozen=True)
class Group:
    """The rows of some estimators of one variant, under a name of its own.

    ``variant`` is the number of the source and of its variant, ``nodes`` are the estimators, and ``attacked``
    those of them that an attack reached in any trial. ``judged`` holds the rows with the packets that
    detectors judged, of fewer trials where these are very many. ``document`` is the resolved topology.
    """

    name: str
    variant: tuple[int, int]
    rows: Rows
    judged: Rows
    nodes: Sequence[str]
    attacked: Sequence[str]
    document: Mapping[str, Any]

    @property
    def from_step(self) -> int:
        """The first step that counts in averages."""
        return int(self._options.get("from_step", 0))

    @property
    def confidence(self) -> float:
        """The confidence of intervals and bounds."""
        return float(self._options.get("confidence", CONFIDENCE))

    @property
    def period_s(self) -> float:
        """The length of a step (s)."""
        return float(self.document["period_s"])

    @property
    def _options(self) -> Mapping[str, Any]:
        return self.document.get("score") or {}

    def of(self, which: str) -> Rows:
        """Return the rows of all estimators, of the attacked ones, or of the one that is named."""
        if which == ALL:
            return self.rows
        names = set(self.attacked) if which == ATTACKED else {which}
        keep = np.array([node in names for node in self.rows.text("node")], dtype=bool)
        places = np.flatnonzero(keep)
        return Rows(self.rows.table.take(places), self.rows.keys, self.rows.trial[keep], self.rows.failed)

    @property
    def passed(self) -> Bools:
        """Which trials (T,) held all that was expected."""
        own = np.zeros(self.rows.trials, dtype=bool)
        own[self.rows.trial[self.rows.scalar("passed") == 1.0]] = True
        return own

    @property
    def diverged(self) -> Bools:
        """In which trials (T,) any of these estimators diverged."""
        own = np.zeros(self.rows.trials, dtype=bool)
        own[self.rows.trial[np.isfinite(self.rows.scalar("divergence_step"))]] = True
        return own


def state_names(groups: Sequence[Group]) -> list[str]:
    """Return the state groups that all tell errors of: ``position`` first, ``state``, all of it, last."""
    told = [state_groups(group.rows.table) for group in groups]
    found = [name for name in told[0] if name != "state" and all(name in own for own in told)]
    return [*sorted(found, key=lambda name: name != "position"), "state"]


@dataclass(frozen=True)
class Outcomes:
    """What became of trials: how many there are, and how many of them were each of these."""

    trials: int
    passed: int
    diverged: int
    failed: int

    @staticmethod
    def of(groups: Sequence[Group]) -> Outcomes:
        """Return the outcomes of the trials of some groups; groups of one variant have the same trials."""
        variants: dict[tuple[int, int], list[Group]] = {}
        for group in groups:
            variants.setdefault(group.variant, []).append(group)
        own = list(variants.values())
        return Outcomes(
            trials=sum(parts[0].rows.trials for parts in own),
            passed=sum(int(np.any([part.passed for part in parts], axis=0).sum()) for parts in own),
            diverged=sum(int(np.any([part.diverged for part in parts], axis=0).sum()) for parts in own),
            failed=sum(int(parts[0].rows.failed.sum()) for parts in own),
        )


def trial_rmse(rows: Rows, group: str) -> Floats:
    """Return the RMSE (T,) of each trial over its estimators: infinite if one diverged, NaN if none came."""
    squares = rows.scalar(f"rmse.{group}") ** 2
    known = ~np.isnan(squares)
    total, count = (rows.by_trial(part) for part in (np.where(known, squares, 0.0), known.astype(np.float64)))
    with np.errstate(invalid="ignore"):
        mean: Floats = np.sqrt(total / count)
    return mean


def short_names(paths: Sequence[str]) -> dict[str, str]:
    """Return for each path as many of its last parts as tell it from the others."""
    found = {}
    for path in paths:
        parts = path.split(".")
        for length in range(1, len(parts) + 1):
            short = ".".join(parts[-length:])
            if sum(f".{other}".endswith(f".{short}") for other in paths) == 1:
                break
        found[path] = short
    return found


def find_groups(sources: Sequence[Source], by: By | None, notes: list[str]) -> list[Group]:
    """Return the groups of some sources, in their order; raises `ReportError` when nothing was scored.

    ``by`` says what estimators of a variant make a group: each alone (``node``), those of one ``method``, or
    all (``variant``). By default it is those that differ in nothing but what they hear.
    """
    found = [
        group
        for number, source in enumerate(sources)
        for group in _groups_of(source, number, source.name if len(sources) > 1 else "", by, notes)
    ]
    if not found:
        raise ReportError(f"{sources[0].path} holds no trial that was scored: there is nothing to report")
    if len(found) > MOST:
        notes.append(f"{MOST} of {len(found)} groups of estimators are reported, the first of them.")
        found = found[:MOST]
    names = [group.name for group in found]
    return [
        group if names.count(group.name) == 1 else replace(group, name=f"{group.name} [{number}]")
        for number, group in enumerate(found, start=1)
    ]


def _groups_of(source: Source, number: int, title: str, by: By | None, notes: list[str]) -> list[Group]:
    table, judged = source.read(lambda name: not name.startswith("packet.")), _judged(source, notes)
    documents, found = source.documents, []
    for variant, settings in settings_by_variant(table).items():
        document = documents[variant] if variant < len(documents) else documents[0]
        try:
            whole = select(table, variant=variant)
        except ColumnError:
            continue
        short = short_names(list(settings))
        own = ", ".join(f"{short[path]} {value}" for path, value in settings.items())
        parts = _parts(whole, document, by)
        for name, nodes in parts.items():
            shown = name if len(parts) > 1 or not (own or title) else ""
            rows = select(table, variant=variant, nodes=nodes)
            found.append(
                Group(
                    name=", ".join(part for part in (title, own, shown) if part),
                    variant=(number, variant),
                    rows=rows,
                    judged=select(judged, variant=variant, nodes=nodes),
                    nodes=nodes,
                    attacked=_attacked(rows),
                    document=document,
                )
            )
    return found


def _judged(source: Source, notes: list[str]) -> pa.Table:
    """Return the rows with their judged packets: of the first trials only, where these are very many."""
    if source.kind == "run":
        return source.table
    import pyarrow.parquet as pq

    file = source.path / RESULTS
    held = pq.ParquetFile(file)
    names = [name for name in held.schema_arrow.names if name in _KEYS or name.startswith(_EVENTS)]
    held = held.metadata
    groups = (held.row_group(i) for i in range(held.num_row_groups))
    packets = sum(
        group.column(i).num_values
        for group in groups
        for i in range(group.num_columns)
        if group.column(i).path_in_schema.startswith("packet.step")
    )
    if packets <= PACKETS:
        return pq.read_table(file, columns=names)
    first, trials = int(source.provenance["first_trial"]), int(source.provenance["trials"])
    some = max(2, trials * PACKETS // packets)
    notes.append(
        f"Detection is told of the first {some} of {trials} trials: {packets:,} packets were judged."
    )
    return pq.read_table(file, columns=names, filters=[("trial", "<", first + some)])


def _parts(rows: Rows, document: Mapping[str, Any], by: By | None) -> dict[str, list[str]]:
    """Return the estimators of a variant that belong together, under a name for each."""
    method = dict(zip(rows.text("node"), rows.text("method"), strict=True))
    privileged = rows.privileged
    if by == "node":
        return {f"{node} PRIVILEGED" if node in privileged else node: [node] for node in method}
    if by == "variant":
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
