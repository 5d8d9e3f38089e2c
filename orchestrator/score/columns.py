"""The columns that a record is gathered into: growing while messages come, arrays in the end."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bus.messages import ChannelEvents
from bus.packets import Packet, Vector
from channel.contract import norm
from channel.happened import Happened
from orchestrator.errors import InputError

MOST_LOOSE = 20_000
"""Messages that are kept as they are until their numbers are packed."""

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


class ScoreError(InputError):
    """The record does not fit its plan; the message says where."""


class Index(dict[str, int]):
    """Indices by name; -1 for an unknown name."""

    def __missing__(self, name: str) -> int:
        return -1


@dataclass(frozen=True)
class Packets:
    """Rows that concern one packet each: ``link`` (its index in the plan, -1: none), ``step``, ``sequence``.

    ``mark`` is True for a verdict that raised the alarm and for an event that attacked (False: lost);
    ``stage`` is the index of the stage that acted (-1: not one of the plan). ``value`` is the Euclidean norm
    of the payload of an injection and of a delivery that may be one, and the test statistic of a verdict
    (NaN: not told).
    """

    link: Ints
    step: Ints
    sequence: Ints
    mark: Bools
    stage: Ints
    value: Floats


COUNTS = ("sent", "lost", "attacked", "delivered", "injected", "duplicated", "refused", "in_flight")
"""What is counted by link: sums over the run, and of ``in_flight`` what was left at its end."""


_OFTEN_ZERO = ("lost", "attacked", "injected", "duplicated", "refused")


class Rows:
    """Columns of `Packets` in the making."""

    def __init__(self) -> None:
        self.link, self.step, self.sequence, self.mark, self.stage = (array("q") for _ in range(5))
        self.value = array("d")

    def packets(self) -> Packets:
        """Return the rows as arrays; columns that were never filled are False or -1."""
        link, step, sequence = (integers(column) for column in (self.link, self.step, self.sequence))
        mark = integers(self.mark).astype(bool) if self.mark else np.zeros(link.size, dtype=bool)
        stage = integers(self.stage) if self.stage else np.full(link.size, -1)
        value = np.array(self.value) if self.value else np.full(link.size, np.nan)
        return Packets(link, step, sequence, mark, stage, value)


def integers(column: array[int]) -> Ints:
    """Return a column as an array."""
    return np.array(column, dtype=np.int64)


def whole(column: Ints) -> array[int]:
    """Return an array as a column."""
    return array("q", np.ascontiguousarray(column, dtype=np.int64).tobytes())


class Payloads:
    """The payloads of delivered packets that somebody may have made."""

    def __init__(self) -> None:
        self._places = array("q")
        self._values: list[Vector] = []

    def take(self, place: int, packets: Sequence[Packet]) -> None:
        """Take those of one inbox, whose first packet stands in this place among the deliveries."""
        self._places.extend(range(place, place + len(packets)))
        self._values += [packet.values for packet in packets]

    def move(self, places: Ints) -> None:
        """Note that the deliveries have been moved: the i-th now stands in ``places[i]``."""
        self._places = whole(places[integers(self._places)])

    def norms(self, wanted: Bools) -> Floats:
        """Return the Euclidean norm of each payload that is wanted and was taken, NaN for the others."""
        norms = np.full(wanted.size, np.nan)
        places = integers(self._places)
        for i in np.flatnonzero(wanted[places]).tolist():
            norms[places[i]] = norm(self._values[i])
        return norms


class Ledger:
    """The counts of one phase and round, step by step, of the links that its events name."""

    __slots__ = ("counted", "link", "round", "step", "topic")

    def __init__(self, topic: str, round_: int, link: Sequence[str]) -> None:
        self.topic = topic
        self.round = round_
        self.link = link
        self.step = array("q")
        self.counted: dict[str, array[int]] = {name: array("q") for name in COUNTS[:-1]}

    def take(self, message: ChannelEvents | Happened) -> None:
        """Take the counts of one step; those that it leaves out are zero on every link."""
        self.step.append(message.step)
        counted = self.counted
        counted["sent"].extend(message.sent)
        counted["delivered"].extend(message.delivered)
        zeros = message.all_zero if isinstance(message, Happened) else ()
        for name in _OFTEN_ZERO:
            if name not in zeros:
                counted[name].extend(getattr(message, name))

    def table(self, name: str) -> Ints:
        """Return a count by step and link; the steps of one that is often left out are not told."""
        column = integers(self.counted[name])
        width = len(self.link)
        if column.size % width if width else column.size:
            raise ScoreError(f"the channel's counts in {self.topic} do not fit its links")
        return column.reshape(column.size // max(width, 1), width)
