"""The columns of rows: their Arrow types, fixed before the first trial by what a topology says.

A column is there whether or not any row has a value in it, so that equal campaigns give equal files.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from bus.extras import installing
from orchestrator.errors import InputError
from orchestrator.evidence.rows import Row, scalar_names

if TYPE_CHECKING:
    import pyarrow as pa

SWEPT = "set."
"""Before the name of a column that holds the values of a ``--set`` with several."""

_KEYS = (
    *(("variant", "int32"), ("trial", "int32"), ("seed", "int64"), ("node", "string"), ("method", "string")),
    *(("network", "int32"), ("privileged", "string"), ("status", "string"), ("message", "string")),
)
_LISTS = (
    *(("packet.step", "int32"), ("packet.link", "string"), ("packet.statistic", "float64")),
    *(("packet.attacked", "bool"), ("packet.alarm", "bool")),
    *(("window.link", "string"), ("window.stage", "string"), ("window.first", "int32")),
    *(("window.last", "int32"), ("window.judged", "bool"), ("window.delay", "float64")),
    ("window.end", "int32"),
)


class MissingPackageError(InputError):
    """A package of an extra is not installed; the text tells how to install it."""


def require_pyarrow() -> None:
    """Raise `MissingPackageError` unless results tables can be written and read."""
    try:
        import pyarrow  # noqa: F401
    except ImportError as error:
        raise MissingPackageError(
            "results are kept in Parquet files, for which pyarrow is missing; "
            f"install it with: {installing('campaign')}"
        ) from error


def columns(groups: Collection[str], swept: Sequence[str] = ()) -> dict[str, str]:
    """Return every column in its order, with the name of its type; ``list.`` before that of a list.

    Parameters
    ----------
    groups
        The plant's state groups, ``state`` not among them.
    swept
        The paths of the ``--set`` with several values.
    """
    steps = {f"error.{group}": "float64" for group in sorted({*groups, "state"})}
    steps |= {"nees": "float64", "nis": "float64", "nis_dof": "int32", "attacked": "bool"}
    steps |= {"disagreement_by_step": "float64", "sent": "int32", "innovation": "float64"}
    steps |= {"attack_on": "bool", "attack_probability": "float64", "attack_error": "float64"}
    steps |= {f"pcrb.{group}": "float64" for group in sorted({*groups, "state"})}
    return {
        **dict(_KEYS),
        **{f"{SWEPT}{path}": "string" for path in swept},
        **dict.fromkeys(("passed", "complete"), "bool"),
        **dict.fromkeys(scalar_names(groups), "float64"),
        **dict.fromkeys(("divergence_step", "slots", "state_size"), "int32"),
        **dict.fromkeys(("pcrb.given", "pcrb.refused"), "string"),
        **{name: f"list.{kind}" for name, kind in (*steps.items(), *_LISTS)},
    }


def schema(groups: Collection[str], swept: Sequence[str] = ()) -> pa.Schema:
    """Return the Arrow schema of a table of rows; the parameters are those of `columns`."""
    import pyarrow as pa

    types: dict[str, pa.DataType] = {
        "int32": pa.int32(),
        "int64": pa.int64(),
        "float64": pa.float64(),
        "bool": pa.bool_(),
        "string": pa.string(),
    }
    fields = []
    for name, kind in columns(groups, swept).items():
        is_list = kind.startswith("list.")
        own = types[kind.removeprefix("list.")]
        fields.append(pa.field(name, pa.list_(own) if is_list else own))
    return pa.schema(fields)


def table(rows: Iterable[Row], schema: pa.Schema) -> pa.Table:
    """Return rows as a table; a column that a row lacks, and NaN in it, is null."""
    import pyarrow as pa

    held = list(rows)
    arrays = [_array([row.get(field.name) for row in held], field.type) for field in schema]
    return pa.Table.from_arrays(arrays, schema=schema)


def _array(values: Sequence[Any], type_: pa.DataType) -> pa.Array:
    """Return one column: lists are laid end to end, which is many times faster than one by one."""
    import numpy as np
    import pyarrow as pa

    if not pa.types.is_list(type_):
        return pa.array(values, type=type_)
    present = [value for value in values if value is not None]
    lengths = np.array([0 if value is None else len(value) for value in values], dtype=np.int64)
    offsets = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32)
    is_null = np.array([value is None for value in values], dtype=bool)
    flat = np.concatenate([np.asarray(value) for value in present if len(value)] or [np.zeros(0)])
    inner = _inner(flat, type_.value_type)
    mask = pa.array(is_null) if is_null.any() else None
    return pa.ListArray.from_arrays(pa.array(offsets), inner, type=type_, mask=mask)


def _inner(flat: Any, type_: pa.DataType) -> pa.Array:
    import pyarrow as pa

    if not len(flat):
        return pa.array([], type=type_)
    return pa.array(flat, type=type_, from_pandas=True)


def swept(names: Iterable[str]) -> list[str]:
    """Return those names of columns that hold the values of a ``--set``."""
    return [name for name in names if name.startswith(SWEPT)]


def settings_by_variant(table: pa.Table) -> dict[int, dict[str, str]]:
    """Return the settings of each variant that a table holds, by path, in the order of the variants."""
    names = swept(table.column_names)
    rows = table.select(["variant", *names]).group_by(["variant", *names]).aggregate([]).to_pylist()
    rows.sort(key=lambda row: row["variant"])
    return {int(row["variant"]): {name.removeprefix(SWEPT): str(row[name]) for name in names} for row in rows}


def swept_columns(settings: Mapping[str, str]) -> Row:
    """Return the values of a variant's ``--set`` as columns of its rows."""
    return {f"{SWEPT}{path}": value for path, value in settings.items()}
