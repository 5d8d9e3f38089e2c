"""A choice of rows of a results table, as arrays."""

from __future__ import annotations

import functools
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from orchestrator.errors import InputError
from orchestrator.evidence.rows import FAILED
from orchestrator.score.gather import Bools, Floats, Ints

if TYPE_CHECKING:
    import pyarrow as pa

Key = tuple[int, int]
"""Seed and trial: what runs with common random numbers share."""

_FIRST = ("position", "velocity", "acceleration")
"""State groups that people name in this order."""

PRIVILEGED, COMPLETE, MISSING = "privileged", "complete", "missing_estimates"
"""Columns that tell what figures must not be taken for."""


class ColumnError(InputError):
    """A table does not hold what was asked for; the text names what it holds."""


@dataclass(frozen=True)
class Rows:
    """Scored rows of one variant, an estimator of a trial each.

    ``keys`` are all its trials in their order, failed ones included, and ``trial`` (R,) the place of each row
    among them. ``failed`` marks the trials that came to no score.
    """

    table: pa.Table
    keys: Sequence[Key]
    trial: Ints
    failed: np.ndarray[Any, np.dtype[np.bool_]]

    @property
    def trials(self) -> int:
        """The number of trials, failed ones included."""
        return len(self.keys)

    @functools.cached_property
    def steps(self) -> int:
        """The number of steps of a trial."""
        return int(self.series("nis_dof").shape[1])

    @property
    def privileged(self) -> dict[str, str]:
        """The estimators that an oracle tells of attacks, and of which; an honest one is not among them."""
        if PRIVILEGED not in self.table.column_names:
            return {}
        told = zip(self.text("node"), self.text(PRIVILEGED), strict=True)
        return {node: attacks for node, attacks in told if attacks}

    @property
    def incomplete(self) -> int:
        """The number of scored trials in whose record something is missing."""
        if COMPLETE not in self.table.column_names:
            return 0
        return int(np.unique(self.trial[self.scalar(COMPLETE) == 0.0]).size)

    @property
    def most_missing(self) -> int:
        """The most estimates that any estimator owes in a trial; of a record cut off, how many steps lack."""
        if MISSING not in self.table.column_names:
            return 0
        return int(np.nanmax(self.scalar(MISSING), initial=0.0))

    @property
    def alive(self) -> Bools:
        """The steps (R, K) before an estimator's divergence."""
        step = self.scalar("divergence_step")
        first = np.where(np.isnan(step), np.inf, step)
        alive: Bools = np.arange(self.steps) < first[:, None]
        return alive

    def scalar(self, name: str) -> Floats:
        """Return a column of numbers (R,), NaN where undefined."""
        return np.asarray(self._column(name).to_numpy(zero_copy_only=False), dtype=np.float64)

    def text(self, name: str) -> list[str]:
        """Return a column of text."""
        return [value or "" for value in self._column(name).to_pylist()]

    def series(self, name: str) -> Floats:
        """Return a column of lists as (R, K), NaN where undefined or where a list is shorter."""
        row, values = self.flat(name)
        lengths = np.bincount(row, minlength=self.trial.size)
        dense = np.full((self.trial.size, int(lengths.max(initial=0))), np.nan)
        begin = np.concatenate([[0], np.cumsum(lengths)])[row]
        dense[row, np.arange(row.size) - begin] = values
        return dense

    def by_step(self, name: str, steps: int) -> Floats:
        """Return a column of lists of M values a step as (R, K, M), NaN where a row has fewer a step."""
        row, values = self.flat(name)
        lengths = np.bincount(row, minlength=self.trial.size)
        each = lengths // max(1, steps)
        dense = np.full((self.trial.size, steps, int(each.max(initial=0))), np.nan)
        at = np.arange(row.size) - np.concatenate([[0], np.cumsum(lengths)])[row]
        step, component = np.divmod(at, np.maximum(each, 1)[row])
        dense[row, step, component] = values
        return dense

    def flat(self, name: str) -> tuple[Ints, Any]:
        """Return a column of lists laid end to end, and to which row each entry belongs; NaN for null."""
        import pyarrow.compute as pc

        column = self._column(name)
        lengths = np.asarray(pc.fill_null(pc.list_value_length(column), 0), dtype=np.int64)
        values = column.combine_chunks().flatten()
        row = np.repeat(np.arange(self.trial.size), lengths)
        if values.type == "string":
            return row, np.array(values.to_pylist(), dtype=object)
        return row, np.asarray(values.to_numpy(zero_copy_only=False), dtype=np.float64)

    def by_trial(self, values: Floats) -> Floats:
        """Return the sum over each trial's rows (T, ...) of values (R, ...)."""
        total = np.zeros((self.trials, *values.shape[1:]))
        np.add.at(total, self.trial, values)
        return total

    def _column(self, name: str) -> Any:
        if name not in self.table.column_names:
            raise ColumnError(f"the results have no column '{name}'; they have {_shown(self.table)}")
        return self.table.column(name)


def _shown(table: pa.Table) -> str:
    return ", ".join(table.column_names)


def select(
    table: pa.Table,
    *,
    variant: int | None = None,
    nodes: Collection[str] | None = None,
    methods: Collection[str] | None = None,
) -> Rows:
    """Return the rows of a variant, of some nodes or of some methods; None for all.

    Raises
    ------
    ColumnError
        When the table has several variants and none is named, or nothing is left.
    """
    import pyarrow.compute as pc

    if variant is not None:
        table = table.filter(pc.equal(table.column("variant"), variant))
    variants = table.column("variant").unique().to_pylist()
    if len(variants) != 1:
        what = f"variants {sorted(variants)}" if variants else f"no variant {variant}"
        raise ColumnError(f"the results hold {what}; name one of those that are there")
    keys = _keys(table)
    number = {key: i for i, key in enumerate(dict.fromkeys(keys))}
    failed = np.zeros(len(number), dtype=bool)
    failed[
        [number[key] for key, status in zip(keys, _texts(table, "status"), strict=True) if status == FAILED]
    ] = True
    table = table.filter(pc.not_equal(table.column("status"), FAILED))
    for name, wanted in (("node", nodes), ("method", methods)):
        if wanted is None:
            continue
        held = sorted(set(_texts(table, name)))
        table = table.filter(pc.is_in(table.column(name), value_set=_array(sorted(wanted))))
        if held and not table.num_rows:
            raise ColumnError(
                f"the results hold no {name} {', '.join(sorted(wanted))}; there is {', '.join(held)}"
            )
    trial = np.array([number[key] for key in _keys(table)], dtype=np.int64)
    return Rows(table, tuple(number), trial, failed)


def _array(values: Sequence[str]) -> Any:
    import pyarrow as pa

    return pa.array(values, type=pa.string())


def _texts(table: pa.Table, name: str) -> list[str]:
    return [str(value) for value in table.column(name).to_pylist()]


def _keys(table: pa.Table) -> list[Key]:
    columns = (table.column(name).to_pylist() for name in ("seed", "trial"))
    return list(zip(*columns, strict=True))


def state_groups(table: pa.Table) -> list[str]:
    """Return the state groups that a table tells errors of, ``state`` among them."""
    return [name.partition(".")[2] for name in table.column_names if name.startswith("error.")]


def in_usual_order(groups: Iterable[str]) -> list[str]:
    """Return state groups as people name them: position, its derivatives, the others as they are given."""
    return sorted(groups, key=lambda name: _FIRST.index(name) if name in _FIRST else len(_FIRST))
