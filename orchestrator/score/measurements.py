"""Measurements as they were sent and as they reached estimators: the record tells which are genuine."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from bus import keys
from bus.messages import Inbox, Transmission
from bus.plan import Plan


@dataclass(frozen=True)
class Measurements:
    """Measurement packets that estimators let in, one a row, in the order of the record.

    ``estimator`` and ``sensor`` are indices in the plan. A packet is ``genuine`` when it holds exactly what
    its sensor sent in the step of its delivery, ``late`` when it holds what its sensor sent before; otherwise
    somebody made or changed it. ``values`` are the payloads. ``sent`` (S, K) tells in which steps each
    sensor sent a packet.
    """

    estimator: NDArray[np.int64]
    sensor: NDArray[np.int64]
    step: NDArray[np.int64]
    genuine: NDArray[np.bool_]
    late: NDArray[np.bool_]
    values: Sequence[list[float]]
    sent: NDArray[np.bool_]


class MeasurementRows:
    """Measurements in the making; messages may come in any order."""

    def __init__(self, plan: Plan) -> None:
        self._estimators = {own.name: i for i, own in enumerate(plan.estimators)}
        self._sensors = {own.name: i for i, own in enumerate(plan.sensors)}
        self._steps = plan.steps
        self._sent: dict[tuple[int, int], tuple[int, list[float]]] = {}
        self._rows = array("q")  # estimator, sensor, step, sequence
        self._values: list[list[float]] = []

    def take_sent(self, node: str, message: Transmission) -> None:
        """Take what a sensor sent in a step."""
        sensor = self._sensors.get(node)
        if sensor is not None:
            payloads = _payloads(message.values, message.offset)
            for sequence, values in zip(message.sequence, payloads, strict=True):
                self._sent[sensor, sequence] = (message.step, values)

    def take_inbox(self, node: str, message: Inbox, let_in: Sequence[bool] | None) -> None:
        """Take what reached an estimator; ``let_in`` marks the packets that passed its gate, None for all."""
        estimator = self._estimators.get(node)
        if estimator is None:
            return
        payloads = _payloads(message.values, message.offset)
        packets = zip(message.source, message.sequence, message.kind, payloads, strict=True)
        for place, (source, sequence, kind, values) in enumerate(packets):
            sensor = self._sensors.get(source)
            if sensor is None or kind != keys.MEASUREMENT or not (let_in is None or let_in[place]):
                continue
            self._rows.extend((estimator, sensor, message.step, sequence))
            self._values.append(values)

    def finish(self) -> Measurements:
        """Return all that was taken."""
        estimator, sensor, step, sequence = np.array(self._rows, dtype=np.int64).reshape(-1, 4).T
        numbers = zip(sensor.tolist(), sequence.tolist(), step.tolist(), self._values, strict=True)
        fates = np.array([self._fate(*packet) for packet in numbers], dtype=np.int64)
        sent = np.zeros((len(self._sensors), self._steps), dtype=bool)
        if self._sent:
            places = [(sensor, step) for (sensor, _), (step, _) in self._sent.items()]
            sent[tuple(np.array(places).T)] = True
        return Measurements(estimator, sensor, step, fates == 0, fates > 0, self._values, sent)

    def _fate(self, sensor: int, sequence: int, step: int, values: list[float]) -> int:
        """Return how many steps late a packet is, -1 when it is not as it was sent."""
        sent_step, sent = self._sent.get((sensor, sequence), (step, None))
        return step - sent_step if sent == values and sent_step <= step else -1


def _payloads(values: list[float], offset: list[int]) -> list[list[float]]:
    return [values[begin:end] for begin, end in pairwise([*offset, len(values)])]
