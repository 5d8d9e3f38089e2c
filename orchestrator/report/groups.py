"""What a page of many trials compares: the estimators of one method in one variant of one source."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from orchestrator.evidence.columns import ColumnError, Rows, select, state_groups
from orchestrator.evidence.sources import Source
from orchestrator.evidence.table import SWEPT
from orchestrator.report.errors import ReportError
from orchestrator.score.gather import Floats

if TYPE_CHECKING:
    import pyarrow as pa

ALL, ATTACKED = "all", "attacked"


@dataclass(frozen=True)
class Group:
    """The rows of one method in one variant, under a name of its own.

    ``settings`` are the variant's own values by their path, ``nodes`` the estimators, and ``attacked`` those
    of them that an attack reached in any trial. ``from_step`` and ``confidence`` are the score's options.
    """

    name: str
    settings: Mapping[str, str]
    method: str
    rows: Rows
    nodes: Sequence[str]
    attacked: Sequence[str]
    from_step: int
    confidence: float
    period_s: float

    def of(self, which: str) -> Rows:
        """Return the rows of all estimators, of the attacked ones, or of the one that is named."""
        if which == ALL:
            return self.rows
        names = set(self.attacked) if which == ATTACKED else {which}
        keep = np.array([node in names for node in self.rows.text("node")], dtype=bool)
        places = np.flatnonzero(keep)
        return Rows(self.rows.table.take(places), self.rows.keys, self.rows.trial[keep], self.rows.failed)

    @property
    def groups(self) -> list[str]:
        """The state groups that errors are told of; ``state``, all of it, comes last."""
        found = state_groups(self.rows.table)
        return [*(name for name in found if name != "state"), "state"]

    def passed(self) -> tuple[int, int]:
        """Return how many trials held all that was expected, and how many there are."""
        own = np.zeros(self.rows.trials, dtype=bool)
        own[self.rows.trial[self.rows.scalar("passed") == 1.0]] = True
        return int(own.sum()), self.rows.trials

    def diverged(self) -> tuple[int, int]:
        """Return in how many scored trials any of the estimators diverged, and how many were scored."""
        own = np.zeros(self.rows.trials, dtype=bool)
        own[self.rows.trial[np.isfinite(self.rows.scalar("divergence_step"))]] = True
        return int(own.sum()), int(np.sum(~self.rows.failed))


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


def find_groups(sources: Sequence[Source]) -> list[Group]:
    """Return the groups of some sources, in their order; raises `ReportError` when none was scored."""
    found = [group for source in sources for group in _groups_of(source, len(sources) > 1)]
    if not found:
        raise ReportError(f"{sources[0].path} holds no trial that was scored: there is nothing to report")
    names = [group.name for group in found]
    return [
        group if names.count(group.name) == 1 else _renamed(group, f"{group.name} [{number}]")
        for number, group in enumerate(found, start=1)
    ]


def _renamed(group: Group, name: str) -> Group:
    from dataclasses import replace

    return replace(group, name=name)


def _groups_of(source: Source, several: bool) -> list[Group]:
    table, documents = source.table, source.documents
    variants = sorted(set(table.column("variant").to_pylist()))
    found = []
    for variant in variants:
        document = documents[variant] if variant < len(documents) else documents[0]
        settings = _settings(table, variant)
        try:
            whole = select(table, variant=variant)
        except ColumnError:
            continue
        methods = list(dict.fromkeys(whole.text("method")))
        short = short_names(list(settings))
        own = ", ".join(f"{short[path]} {value}" for path, value in settings.items())
        for method in methods:
            parts = [source.name if several else "", own, method if len(methods) > 1 or not own else ""]
            rows = select(table, variant=variant, methods=[method])
            found.append(_group(", ".join(part for part in parts if part), settings, method, rows, document))
    return found


def _settings(table: pa.Table, variant: int) -> dict[str, str]:
    swept = [name for name in table.column_names if name.startswith(SWEPT)]
    at = table.column("variant").to_pylist().index(variant)
    return {name.removeprefix(SWEPT): str(table.column(name)[at].as_py()) for name in swept}


def _group(
    name: str, settings: Mapping[str, str], method: str, rows: Rows, document: Mapping[str, Any]
) -> Group:
    options = document.get("score") or {}
    nodes = rows.text("node")
    hit = np.nansum(rows.series("attacked"), axis=1) > 0
    return Group(
        name=name,
        settings=settings,
        method=method,
        rows=rows,
        nodes=tuple(dict.fromkeys(nodes)),
        attacked=tuple(dict.fromkeys(node for node, own in zip(nodes, hit, strict=True) if own)),
        from_step=int(options.get("from_step", 0)),
        confidence=float(options.get("confidence", 0.95)),
        period_s=float(document["period_s"]),
    )
