"""The tables of a run as CSV files: a cell a number, without names of state groups."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bus.messages import ChannelEvents, Estimate, Inbox, Message, Transmission, Truth
from orchestrator.handoff.columns import COUNTS, event_rows, link_rows, packet_rows
from orchestrator.log.reader import Log

CSV_TABLES = ("truth", "estimates", "detections", "packets", "links", "events")

Row = Sequence[Any]


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


@dataclass
class _Widths:
    """How many numbers a row of a CSV file needs room for."""

    state: int = 0
    control: int = 0
    attack: int = 0
    estimate: int = 0

    def hold(self, message: Message) -> None:
        """Make room for a message."""
        if isinstance(message, Truth):
            self.state = max(self.state, len(message.state))
            self.control = max(self.control, len(message.control))
            self.attack = max(self.attack, len(message.attack))
        elif isinstance(message, Estimate):
            self.estimate = max(self.estimate, len(message.state))


def _upper(n: int) -> list[tuple[int, int]]:
    """Return the places of the upper triangle of a matrix, row by row."""
    return [(i, j) for i in range(n) for j in range(i, n)]


class _Tables:
    """The CSV files of a log, open: one row after another goes to the table that it belongs to.

    ``methods`` names the method of each estimator.
    """

    def __init__(self, out: Path, width: _Widths, methods: Mapping[str, str], files: ExitStack) -> None:
        self.paths: list[Path] = []
        self._out = out
        self._files = files
        self._width = width
        self._methods = methods
        n = width.estimate
        columns = [*_numbered("x", n), *_numbered("sigma", n), *[f"cov{i}_{j}" for i, j in _upper(n)]]
        entering = [*_numbered("control", width.control), *_numbered("attack", width.attack)]
        self._truth = self._open("truth", "step t", [*_numbered("x", width.state), *entering])
        self._estimates = self._open(
            "estimates", "step t node method refers_to diverged nis nis_dof refused", columns
        )
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
            entering = [
                *_pad(message.control, self._width.control),
                *_pad(message.attack, self._width.attack),
            ]
            self._truth([message.step, message.t, *message.state, *entering])
        elif isinstance(message, Transmission | Inbox):
            for row in packet_rows(topic, message):
                self._packets(_in_one_cell(row))
        elif isinstance(message, ChannelEvents):
            for row in link_rows(_node(topic), message):
                self._links(row)
            for row in event_rows(_node(topic), message):
                self._events(row)
        elif isinstance(message, Estimate):
            self._add_estimate(_node(topic), message)
            for row in _detection_rows(topic, message):
                self._detections(row)

    def _add_estimate(self, node: str, message: Estimate) -> None:
        n = len(message.state)
        half = [message.covariance[i * n + j] for i, j in _upper(n)]
        nis = message.nis if message.nis_dof else ""
        told = [message.refers_to, message.diverged, nis, message.nis_dof, message.refused]
        most = self._width.estimate
        numbers = [*_pad(message.state, most), *_pad(message.sigma, most), *_pad(half, len(_upper(most)))]
        self._estimates([message.step, message.t, node, self._methods.get(node, ""), *told, *numbers])


def _methods(log: Log) -> dict[str, str]:
    estimators = log.topology.get("topology", {}).get("estimators", {})
    return {name: own["method"].rpartition(":")[2] for name, own in estimators.items()}


def write_tables(log: Log, out: Path) -> list[Path]:
    """Write the tables of a log into files of a folder that holds none of them; return the files."""
    width = _Widths()
    for _, message in log.records():
        width.hold(message)
    with ExitStack() as files:
        tables = _Tables(out, width, _methods(log), files)
        for topic, message in log.records():
            tables.add(topic, message)
    return tables.paths
