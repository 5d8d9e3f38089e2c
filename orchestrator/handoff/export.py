"""Hands a log over to other tools: CSV or Parquet tables, JSON lines, or NumPy arrays."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, get_args

import msgspec
import numpy as np

from bus.messages import Estimate, Truth
from orchestrator.choices import ExportFormat
from orchestrator.handoff.csv_tables import CSV_TABLES, write_tables
from orchestrator.log.errors import LogError
from orchestrator.log.reader import Log, read_log
from orchestrator.score.columns import Floats

_SCALARS = frozenset({"step", "t", "nis", "nis_dof", "refers_to"})
_JSONL, _NPZ = "messages.jsonl", "log.npz"


def _to_jsonl(log: Log, out: Path) -> list[Path]:
    path = out / _JSONL
    with path.open("xb") as stream:
        for topic, _, payload in log.payloads():
            stream.write(msgspec.json.encode({"topic": topic, "message": msgspec.Raw(payload)}) + b"\n")
    return [path]


def _stack(rows: Sequence[Sequence[float]]) -> Floats:
    """Return rows as an array; those that are shorter, as of a diverged estimator, are filled with NaN."""
    width = max(map(len, rows), default=0)
    return np.array([[*row, *[np.nan] * (width - len(row))] for row in rows]).reshape(len(rows), width)


def _to_npz(log: Log, out: Path) -> list[Path]:
    columns: dict[str, list[Sequence[float]]] = {}

    def add(name: str, row: Sequence[float]) -> None:
        columns.setdefault(name, []).append(row)

    for topic, message in log.records():
        if isinstance(message, Truth):
            add("step", [message.step])
            add("t", [message.t])
            add("truth", message.state)
        elif isinstance(message, Estimate):
            node = topic.split("/")[1]
            add(f"estimate/{node}", message.state)
            add(f"sigma/{node}", message.sigma)
            add(f"covariance/{node}", message.covariance)
            add(f"nis/{node}", [message.nis if message.nis_dof else np.nan])
            add(f"nis_dof/{node}", [message.nis_dof])
            add(f"refers_to/{node}", [message.refers_to])
    path = out / _NPZ
    arrays: dict[str, Any] = {name: _shaped(name, _stack(rows)) for name, rows in columns.items()}
    with path.open("xb") as stream:
        np.savez_compressed(stream, **arrays)
    return [path]


def _shaped(name: str, array: Floats) -> Floats:
    kind = name.split("/")[0]
    if kind == "covariance":
        n = math.isqrt(array.shape[1])
        return array.reshape(len(array), n, n)
    return array.ravel() if kind in _SCALARS else array


def _to_parquet(log: Log, out: Path) -> list[Path]:
    from orchestrator.handoff.frames import require

    require("pyarrow")
    import pyarrow.parquet as pq

    from orchestrator.handoff.run import TABLES, Run

    run = Run(log.path)
    paths = [out / f"{name}.parquet" for name in TABLES]
    for path in paths:
        with path.open("xb") as stream:
            pq.write_table(run.table(path.stem), stream)
    return paths


_WRITERS: dict[str, Callable[[Log, Path], list[Path]]] = {
    "csv": write_tables,
    "jsonl": _to_jsonl,
    "npz": _to_npz,
    "parquet": _to_parquet,
}


def _file_names(form: ExportFormat) -> Sequence[str]:
    if form == "parquet":
        from orchestrator.handoff.run import TABLES  # late: it takes a second

        return [f"{name}.parquet" for name in TABLES]
    return {"csv": [f"{name}.csv" for name in CSV_TABLES], "jsonl": [_JSONL], "npz": [_NPZ]}[form]


def export(path: Path, form: ExportFormat, out: Path) -> list[Path]:
    """Write a log's content into files of a folder and return them: all of them, or none.

    Raises `LogError` rather than write over a file. ``csv``: a table a kind (truth, estimates, detections,
    packets, links, events). ``jsonl``: one line a message, in ``messages.jsonl``. ``npz``: ``log.npz`` with
    ``step``, ``t`` (K,), ``truth`` (K, n), and by estimator ``estimate/e1``, ``sigma/e1`` (K, n),
    ``covariance/e1`` (K, n, n), ``nis/e1``, ``nis_dof/e1``, ``refers_to/e1`` (K,); a row a step, NaN if
    diverged, and in ``nis`` where no packet came. ``parquet``: a typed table for each frame of
    `orchestrator.handoff.run.Run`.
    """
    if form not in _WRITERS:
        raise LogError(f"there is no format {form!r}; take one of {', '.join(get_args(ExportFormat))}")
    log, names = read_log(path), _file_names(form)
    is_new = not out.exists()
    try:
        out.mkdir(parents=True, exist_ok=True)
        _refuse_to_overwrite(out, names)
        with TemporaryDirectory(prefix=".export-", dir=out) as beside:
            written = _WRITERS[form](log, Path(beside))
            _refuse_to_overwrite(out, names)  # what came meanwhile
            return [own.rename(out / own.name) for own in written]
    except FileExistsError as error:
        raise LogError(f"{error.filename} exists already; export to another folder") from error
    except OSError as error:
        raise LogError(f"{out} cannot be written: {error.strerror}; export to another folder") from error
    finally:
        if is_new and out.is_dir() and not any(out.iterdir()):
            out.rmdir()


def _refuse_to_overwrite(out: Path, names: Sequence[str]) -> None:
    for name in names:
        if os.path.lexists(out / name):
            raise LogError(f"{out / name} exists already; export to another folder")
