"""Hands a log over to other tools: CSV or Parquet tables, JSON lines, or NumPy arrays."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, get_args

import msgspec
import numpy as np

from bus.messages import ChannelEvents, Estimate, Inbox, Message, Transmission, Truth
from orchestrator.choices import ExportFormat
from orchestrator.handoff.columns import COUNTS, event_rows, link_rows, packet_rows
from orchestrator.log.errors import LogError
from orchestrator.log.reader import Log, read_log

Row = Sequence[Any]

_SCALARS = frozenset({"step", "t", "nis", "refers_to"})


def _node(topic: str) -> str:
    return topic.split("/")[1]


def _in_one_cell(packet: Row) -> Row:
    """Return a packet's row with its values, which come last, as text with blanks between."""
    return (*packet[:-1], " ".join(map(repr, packet[-1])))


def _detection_rows(topic: str, message: Estimate) -> Iterator[Row]:
    detections = zip(
        message.detector_source,
        message.detector_sequence,
        message.detector_statistic,
        message.detector_alarm,
        strict=True,
    )
    for detection in detections:
        yield (message.step, message.t, _node(topic), *detection)


def _pad(values: Sequence[float], width: int) -> list[Any]:
    return [*values, *[""] * (width - len(values))]


def _numbered(name: str, width: int) -> list[str]:
    return [f"{name}{index}" for index in range(width)]


class _Tables:
    """The CSV files of a log, open: one row after another goes to the table that it belongs to."""

    def __init__(self, out: Path, width: dict[type[Message], int], files: ExitStack) -> None:
        self.paths: list[Path] = []
        self._out = out
        self._files = files
        self._width = width[Estimate]
        columns = [*_numbered("x", self._width), *_numbered("sigma", self._width)]
        self._truth = self._open("truth", "step t", _numbered("x", width[Truth]))
        self._estimates = self._open("estimates", "step t node refers_to diverged nis nis_dof", columns)
        self._detections = self._open("detections", "step t node source sequence statistic alarm")
        self._packets = self._open(
            "packets", "step t direction node round stream source sent_step sequence values"
        )
        self._links = self._open("links", "step t phase round link", COUNTS)
        self._events = self._open("events", "step t phase round link stage sequence action magnitude")

    def _open(self, name: str, columns: str, more: Sequence[str] = ()) -> Callable[[Row], Any]:
        path = self._out / f"{name}.csv"
        self.paths.append(path)
        write = csv.writer(self._files.enter_context(path.open("x", newline=""))).writerow
        write([*columns.split(), *more])
        return write

    def add(self, topic: str, message: Message) -> None:
        """Write a message's rows."""
        if isinstance(message, Truth):
            self._truth([message.step, message.t, *message.state])
        elif isinstance(message, Transmission | Inbox):
            for row in packet_rows(topic, message):
                self._packets(_in_one_cell(row))
        elif isinstance(message, ChannelEvents):
            for row in link_rows(_node(topic), message):
                self._links(row)
            for row in event_rows(_node(topic), message):
                self._events(row)
        elif isinstance(message, Estimate):
            head = [message.step, message.t, _node(topic), message.refers_to, message.diverged]
            state = [*_pad(message.state, self._width), *_pad(message.sigma, self._width)]
            self._estimates([*head, message.nis, message.nis_dof, *state])
            for row in _detection_rows(topic, message):
                self._detections(row)


def _to_csv(log: Log, out: Path) -> list[Path]:
    width: dict[type[Message], int] = {Truth: 0, Estimate: 0}
    for _, message in log.records():
        if isinstance(message, Truth | Estimate):
            width[type(message)] = max(width[type(message)], len(message.state))
    with ExitStack() as files:
        tables = _Tables(out, width, files)
        for topic, message in log.records():
            tables.add(topic, message)
    return tables.paths


def _to_jsonl(log: Log, out: Path) -> list[Path]:
    path = out / "messages.jsonl"
    with path.open("xb") as stream:
        for topic, _, payload in log.payloads():
            stream.write(msgspec.json.encode({"topic": topic, "message": msgspec.Raw(payload)}) + b"\n")
    return [path]


def _stack(rows: Sequence[Sequence[float]]) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
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
            node = _node(topic)
            add(f"estimate/{node}", message.state)
            add(f"sigma/{node}", message.sigma)
            add(f"nis/{node}", [message.nis])
            add(f"refers_to/{node}", [message.refers_to])
    path = out / "log.npz"
    arrays: dict[str, Any] = {name: _stack(rows) for name, rows in columns.items()}
    arrays |= {name: array.ravel() for name, array in arrays.items() if name.split("/")[0] in _SCALARS}
    with path.open("xb") as stream:
        np.savez_compressed(stream, **arrays)
    return [path]


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
    "csv": _to_csv,
    "jsonl": _to_jsonl,
    "npz": _to_npz,
    "parquet": _to_parquet,
}


def export(path: Path, form: ExportFormat, out: Path) -> list[Path]:
    """Write a log's content into files of a folder and return them; existing files are not overwritten.

    ``csv``: a table a kind (truth, estimates, detections, packets, links, events). ``jsonl``: one line a
    message, in ``messages.jsonl``. ``npz``: ``log.npz`` with ``step``, ``t`` (K,), ``truth`` (K, n), and by
    estimator ``estimate/e1``, ``sigma/e1`` (K, n), ``nis/e1``, ``refers_to/e1`` (K,); a row a step, NaN if
    diverged. ``parquet``: a typed table for each frame of `orchestrator.handoff.run.Run`.
    """
    if form not in _WRITERS:
        raise LogError(f"there is no format {form!r}; take one of {', '.join(get_args(ExportFormat))}")
    log = read_log(path)
    try:
        out.mkdir(parents=True, exist_ok=True)
        return _WRITERS[form](log, out)
    except FileExistsError as error:
        raise LogError(f"{error.filename} exists already; export to another folder") from error
    except OSError as error:
        raise LogError(f"{out} cannot be written: {error.strerror}; export to another folder") from error
