"""Measurements as they were sent and as they reached estimators: the record tells which are genuine."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from bus import keys
from bus.messages import Inbox, Transmission
from bus.packets import Delivery
from bus.plan import Plan

_ONE_PACKET = [0]
_CHANGED = -1


@dataclass(frozen=True)
class Measurements:
    """Measurement packets that estimators let in, one a row, in the order of the record.

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
    """Measurements in the making; messages may come in any order, and are looked at when all have come."""

    def __init__(self, plan: Plan) -> None:
        self._sensors = {own.name: i for i, own in enumerate(plan.sensors)}
        self._senders = {keys.tx(own.name, keys.MEASUREMENT): i for i, own in enumerate(plan.sensors)}
        self._receivers = {keys.rx(own.name, keys.CORRECT): i for i, own in enumerate(plan.estimators)}
        self._steps = plan.steps
        self._sent: list[tuple[int, int, list[int], list[int], list[float]]] = []
        self._came: list[tuple[int, Inbox | Delivery, Sequence[int]]] = []

    def take_sent(self, topic: str, message: Transmission) -> None:
        """Take what a node sent in a step, if it is a sensor's measurement."""
        sensor = self._senders.get(topic)
        if sensor is not None:
            self._sent.append((sensor, message.step, message.sequence, message.offset, message.values))

    def take_inbox(self, topic: str, message: Inbox | Delivery, links: Sequence[int]) -> None:
        """Take what reached a node; ``links`` tells the link of each packet, below -1 for one not let in."""
        estimator = self._receivers.get(topic)
        if estimator is not None:
            self._came.append((estimator, message, links))

    def finish(self) -> Measurements:
        """Return all that was taken."""
        originals, sent = self._originals()
        rows, flat = array("q"), array("d")
        numbers, steps = self._sensors, self._steps
        for estimator, message, links in self._came:
            step = message.step
            for (source, sequence, kind, payload), link in zip(_packets(message), links, strict=True):
                sensor = numbers.get(source, -1)
                if sensor < 0 or kind != keys.MEASUREMENT or link < -1:
                    continue
                sent_step, original = originals.get((sensor, sequence), (steps, None))
                late = step - sent_step if original == payload and sent_step <= step else _CHANGED
                rows.extend((estimator, sensor, step, late, len(payload)))
                flat.extend(payload)
        estimators, sensors, delivered, by, size = np.array(rows, dtype=np.int64).reshape(-1, 5).T
        values = np.array(flat, dtype=np.float64)
        return Measurements(estimators, sensors, delivered, by == 0, by > 0, values, size, sent)

    def _originals(self) -> tuple[dict[tuple[int, int], tuple[int, list[float]]], NDArray[np.bool_]]:
        """Return step and payload of each packet that was sent, by sensor and number; and when they sent."""
        originals: dict[tuple[int, int], tuple[int, list[float]]] = {}
        sent = np.zeros((len(self._sensors), self._steps), dtype=bool)
        for sensor, step, sequences, offset, values in self._sent:
            for sequence, payload in zip(sequences, _payloads(values, offset), strict=True):
                originals[sensor, sequence] = (step, payload)
        senders = np.array([(own[0], own[1]) for own in self._sent if own[2]], dtype=np.int64).reshape(-1, 2)
        sensors, steps = senders[(senders[:, 1] >= 0) & (senders[:, 1] < self._steps)].T
        sent[sensors, steps] = True
        return originals, sent


def _packets(message: Inbox | Delivery) -> Iterable[tuple[str, int, str, list[float]]]:
    """Return source, number, kind and payload of each packet."""
    if isinstance(message, Delivery):
        return [(own.source, own.sequence, own.kind, own.values.tolist()) for own in message.packets]
    payloads = _payloads(message.values, message.offset)
    return zip(message.source, message.sequence, message.kind, payloads, strict=True)


def _payloads(values: list[float], offset: list[int]) -> list[list[float]]:
    if offset == _ONE_PACKET:
        return [values]
    return [values[begin:end] for begin, end in pairwise([*offset, len(values)])]
