"""Arrow tables, and frames of the library that the user chose."""

from __future__ import annotations

import importlib
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from bus.extras import installing
from orchestrator.evidence.table import MissingPackageError
from orchestrator.score.gather import Ints

if TYPE_CHECKING:
    import pyarrow as pa

Library = Literal["polars", "pandas"]


def require(*packages: str) -> None:
    """Raise `MissingPackageError` unless the packages can be imported."""
    for package in packages:
        try:
            importlib.import_module(package)
        except ImportError as error:
            raise MissingPackageError(
                f"{package} is missing; install what frames and arrays need with: {installing('frames')}"
            ) from error


def arrow_table(types: Mapping[str, str], rows: Sequence[Sequence[Any]]) -> pa.Table:
    """Return rows as a table with the given columns and types."""
    import pyarrow as pa

    kinds = {"int64": pa.int64(), "float64": pa.float64(), "bool": pa.bool_(), "string": pa.string()}
    fields = [
        (name, pa.list_(kinds[kind.removeprefix("list.")]) if kind.startswith("list.") else kinds[kind])
        for name, kind in types.items()
    ]
    columns = list(zip(*rows, strict=True)) or [()] * len(fields)
    arrays = [pa.array(column, type=kind) for column, (_, kind) in zip(columns, fields, strict=True)]
    return pa.Table.from_arrays(arrays, names=list(types))


def exploded(rows: pa.Table, keys: Sequence[str], series: Mapping[str, str], counter: str = "") -> pa.Table:
    """Return a table with one row for each entry of the series.

    Parameters
    ----------
    rows
        A table; the lists of a row have the length of its first series, or are null.
    keys
        Columns to repeat for each entry.
    series
        Columns of lists to lay end to end, with the name that each shall have.
    counter
        The name of a column that counts the entries of a row from 0; empty for none.
    """
    import pyarrow as pa
    import pyarrow.compute as pc

    rows = rows.combine_chunks()
    lengths = _lengths(rows, next(iter(series)))
    row = np.repeat(np.arange(lengths.size), lengths)
    place = np.arange(row.size) - (np.cumsum(lengths) - lengths)[row]
    columns: dict[str, Any] = {name: rows[name].take(pa.array(row)) for name in keys}
    if counter:
        columns[counter] = pa.array(place, type=pa.int64())
    for column, name in series.items():
        own = _lengths(rows, column)
        missing = own[row] == 0
        index = np.where(missing, 0, (np.cumsum(own) - own)[row] + place)
        columns[name] = pc.list_flatten(rows[column]).take(pa.array(index, mask=missing))
    return pa.table(columns)


def _lengths(rows: pa.Table, column: str) -> Ints:
    """Return the length of each list of a column; 0 for null."""
    import pyarrow.compute as pc

    return np.asarray(pc.fill_null(pc.list_value_length(rows[column]), 0), dtype=np.int64)


def frame(table: pa.Table, library: Library) -> Any:
    """Return a table as a frame of polars or pandas."""
    require(library)
    if library == "pandas":
        return table.to_pandas()
    import polars

    return polars.from_arrow(table)
