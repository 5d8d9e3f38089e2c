"""Measurements as they were sent and as they reached estimators: the record tells which are genuine."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bus import keys
from bus.packets import Packet, Vector
from bus.plan import Plan

_CHANGED = -1


@dataclass(frozen=True)
class Measurements:
    """Measurement packets that estimators let in, one a row; those of one inbox stand in its order.

    ``estimator`` and ``sensor`` are indices in the plan. A packet is ``genuine`` when it holds exactly what
    its sensor sent in the step of its delivery, ``late`` when it holds what its sensor sent before; otherwise
    somebody made or changed it. ``values`` holds the payloads end to end, ``size`` the length of each.
    ``sent`` (S, K) tells in which steps each sensor sent a packet.
    """

    estimator: NDArray[np.int64]
    sensor: NDArray[np.int64]
    step: NDArray[np.int64]
    genuine: NDArray[np.bool_]
    late: NDArray[np.bool_]
    values: NDArray[np.float64]
    size: NDArray[np.int64]
    sent: NDArray[np.bool_]


class MeasurementRows:
    """Measurements in the making; what is not known to be untouched is compared when everything has come."""

    def __init__(self, plan: Plan) -> None:
        self._sensors = {own.name: i for i, own in enumerate(plan.sensors)}
        self.receivers = {keys.rx(own.name, keys.CORRECT): i for i, own in enumerate(plan.estimators)}
        estimators = {own.name: i for i, own in enumerate(plan.estimators)}
        self._estimator = [estimators.get(link.destination, -1) for link in plan.links]
        self._sensor = [self._sensors.get(link.source, -1) for link in plan.links]
        self._steps = plan.steps
        self._originals: dict[tuple[int, int], tuple[int, Vector]] = {}
        self._sent = np.zeros((len(self._sensors), self._steps), dtype=bool)
        self._rows = tuple(array("q") for _ in range(4))
        """Estimator, sensor, step and number of each packet."""
        self._values: list[Vector] = []
        self._doubts: list[range] = []
        """Rows of packets that may not be what their sensors sent."""

    def sender(self, source: str) -> Callable[[int, Sequence[Packet]], None]:
        """Return what takes what a sensor sent in a step."""
        sensor, originals, steps = self._sensors[source], self._originals, self._steps
        sent = self._sent[sensor]

        def take(step: int, packets: Sequence[Packet]) -> None:
            for packet in packets:
                originals[sensor, packet.sequence] = step, packet.values
                if 0 <= step < steps:
                    sent[step] = True

        return take

    def take_arrived(
        self,
        estimator: int,
        step: int,
        packets: Sequence[Packet],
        links: Sequence[int],
    ) -> None:
        """Take an inbox of one of the ``receivers``.

        ``links`` tells the link of each packet, below -1 for one not let in.
        """
        numbers, begin = self._sensors, len(self._values)
        kept = [
            packet
            for packet, link in zip(packets, links, strict=True)
            if link >= -1 and packet.kind == keys.MEASUREMENT and packet.source in numbers
        ]
        columns = (
            [estimator] * len(kept),
            [numbers[packet.source] for packet in kept],
            [step] * len(kept),
            [packet.sequence for packet in kept],
        )
        for column, own in zip(self._rows, columns, strict=True):
            column.extend(own)
        self._values += [packet.values for packet in kept]
        self._doubts.append(range(begin, len(self._values)))

    def take_untouched(self, links: NDArray[np.int64], steps: NDArray[np.int64]) -> None:
        """Take what some links carried in some steps: the packets that their sensors sent then."""
        originals = self._originals
        sensor = np.array(self._sensor, dtype=np.int64)[links]
        values = [originals[place][1] for place in zip(sensor.tolist(), steps.tolist(), strict=True)]
        columns = (np.array(self._estimator, dtype=np.int64)[links], sensor, steps, steps)
        for column, own in zip(self._rows, columns, strict=True):
            column.frombytes(own.tobytes())
        self._values += values

    def finish(self) -> Measurements:
        """Return all that was taken."""
        estimators, sensors, delivered, _ = (np.array(column, dtype=np.int64) for column in self._rows)
        _, sensor, step, number = self._rows
        by = np.zeros(len(self._values), dtype=np.int64)
        for rows in self._doubts:
            by[rows] = [self._late(sensor[i], number[i], step[i], self._values[i]) for i in rows]
        size = np.array([len(own) for own in self._values], dtype=np.int64)
        values = np.concatenate([np.zeros(0), *self._values])
        return Measurements(estimators, sensors, delivered, by == 0, by > 0, values, size, self._sent)

    def _late(self, sensor: int, sequence: int, step: int, values: Vector) -> int:
        """Return how many steps after it was sent a packet came, `_CHANGED` for one that nobody sent so."""
        sent_step, original = self._originals.get((sensor, sequence), (self._steps, values))
        if sent_step > step or (original is not values and not _alike(original, values)):
            return _CHANGED
        return step - sent_step


def _alike(one: Vector, other: Vector) -> bool:
    """Return whether payloads are equal; most that differ do so in their first entry."""
    if one.size != other.size or (one.size and one.item(0) != other.item(0)):
        return False
    return bool(one.tolist() == other.tolist())
