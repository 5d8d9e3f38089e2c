"""Tables of what runs showed, made from rows of evidence: the same for one run and for a campaign."""

from __future__ import annotations

import functools
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from orchestrator.handoff.frames import Library, exploded, frame

if TYPE_CHECKING:
    import pyarrow as pa

_ERROR, _BOUND = "error.", "pcrb."
_FIGURES = ("nees", "nis", "nis_dof", "attacked", "sent")
_PACKET, _WINDOW = "packet.", "window."


def _with_time(table: pa.Table, keys: Sequence[str], period_s: float | None) -> pa.Table:
    """Return a table with keys and ``step`` first, and with the time when there is one period."""
    import numpy as np
    import pyarrow as pa

    rest = [name for name in table.column_names if name not in (*keys, "step")]
    columns = {name: table[name] for name in (*keys, "step")}
    if period_s is not None:
        columns["t"] = pa.array(np.asarray(table["step"]) * period_s, type=pa.float64())
    return pa.table({**columns, **{name: table[name] for name in rest}})


def _of_prefix(rows: pa.Table, prefix: str) -> dict[str, str]:
    return {name: name.removeprefix(prefix) for name in rows.column_names if name.startswith(prefix)}


def errors(rows: pa.Table, keys: Sequence[str], period_s: float | None = None) -> pa.Table:
    """Return a row an estimator and step: the norm of its error in each state group, and other figures.

    Where results have the posterior Cramer-Rao bound of a group, it is there as ``bound_<group>``.
    """
    series = {**_of_prefix(rows, _ERROR), **{name: name for name in _FIGURES}}
    series |= {f"{_BOUND}{name}": f"bound_{name}" for name in bounded_groups(rows)}
    return _with_time(exploded(rows, keys, series, counter="step"), keys, period_s)


def bounded_groups(rows: pa.Table) -> list[str]:
    """Return the state groups for which results have a bound at every step."""
    groups = _of_prefix(rows, _ERROR).values()
    return [group for group in groups if f"{_BOUND}{group}" in rows.column_names]


def detections(rows: pa.Table, keys: Sequence[str], period_s: float | None = None) -> pa.Table:
    """Return a row a packet that was delivered on a link with a detector."""
    return _with_time(exploded(rows, keys, _of_prefix(rows, _PACKET)), keys, period_s)


def windows(rows: pa.Table, keys: Sequence[str], period_s: float | None = None) -> pa.Table:
    """Return a row an attack window on a link into an estimator; a null delay says that no alarm came."""
    return exploded(rows, keys, _of_prefix(rows, _WINDOW))


def results(rows: pa.Table, keys: Sequence[str], period_s: float | None = None) -> pa.Table:
    """Return a row an estimator with all its figures: every column that is no list."""
    import pyarrow as pa

    scalars = [field.name for field in rows.schema if not pa.types.is_list(field.type)]
    return rows.select(scalars)


EVIDENCE: Mapping[str, Callable[[pa.Table, Sequence[str], float | None], pa.Table]] = {
    "errors": errors,
    "detections": detections,
    "windows": windows,
    "results": results,
}
"""The tables that come from comparing runs with the truth, by name."""


class EvidenceFrames(ABC):
    """The frames that a run and a campaign have in common, each computed when it is first asked for."""

    def __init__(self, library: Library) -> None:
        self.library = library

    @abstractmethod
    def table(self, name: str) -> pa.Table:
        """Return one of the frames as an Arrow table."""

    @functools.cached_property
    def errors(self) -> Any:
        """A row a trial, estimator and step: error norms by state group, ``nees``, ``nis``, ``attacked``."""
        return self._frame("errors")

    @functools.cached_property
    def detections(self) -> Any:
        """A row a packet that a detector may judge: ``statistic``, ``alarm``, and whether ``attacked``."""
        return self._frame("detections")

    @functools.cached_property
    def windows(self) -> Any:
        """A row an attack window on a link: its first and last step, and the ``delay`` of its detection."""
        return self._frame("windows")

    def _frame(self, name: str) -> Any:
        return frame(self.table(name), self.library)
