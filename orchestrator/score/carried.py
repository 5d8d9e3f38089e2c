"""What is gathered where no record is kept: packets and beliefs as the programs have them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from bus.messages import TOPIC_TYPES, Estimate, Inbox
from bus.packets import Delivery, Packet, Sending
from nodes.published import Published
from orchestrator.score.gather import Gatherer


class Carried:
    """Lets a gatherer take forms; packets are kept as they are until `pack` takes those of many steps."""

    def __init__(self, gatherer: Gatherer) -> None:
        self._gatherer = gatherer
        self._sent: dict[str, list[Sending]] = {}
        self._delivered: dict[str, list[Delivery]] = {}

    def taker(self, topic: str) -> Callable[[Any], None] | None:
        """Return what takes the forms of a topic, None when no score needs them."""
        root, name, *_ = topic.split("/")
        if TOPIC_TYPES[root] is Estimate:
            return _published(self._gatherer, name)
        if TOPIC_TYPES[root] is Inbox:
            return self._delivered.setdefault(topic, []).append
        if topic in self._gatherer.measuring:
            return self._sent.setdefault(name, []).append
        return None

    def pack(self) -> None:
        """Take what is kept."""
        for sensor, slots in self._sent.items():
            for slot in slots:
                self._gatherer.take_measured(sensor, slot.step, slot.packets)
            slots.clear()
        for topic, inboxes in self._delivered.items():
            self._take_inboxes(topic, inboxes)
            inboxes.clear()

    def _take_inboxes(self, topic: str, inboxes: list[Delivery]) -> None:
        gatherer = self._gatherer
        rows, incoming = gatherer.deliveries, gatherer.receivers[topic]
        hearer = gatherer.false_data.receivers.get(topic)
        estimator = gatherer.measurements.receivers.get(topic)
        packets: list[Packet] = []
        links: list[int] = []
        for inbox in inboxes:
            arrived = inbox.packets
            if inbox.untouched:
                into = [incoming[packet.source] for packet in arrived]
            else:
                into = gatherer.let_in(topic, arrived)
                gatherer.payloads.take(len(rows.link) + len(links), arrived)
            packets += arrived
            links += into
            if hearer is not None:
                gatherer.false_data.take_inbox(hearer, inbox.step, arrived)
            if estimator is not None:
                gatherer.measurements.take_inbox(
                    estimator, inbox.step, arrived, into, untouched=inbox.untouched
                )
        rows.link.extend(links)
        rows.step.extend([inbox.step for inbox in inboxes for _ in inbox.packets])
        rows.sequence.extend([packet.sequence for packet in packets])


def _published(gatherer: Gatherer, name: str) -> Callable[[Published], None]:
    """Return what takes an estimator's beliefs at once, for they are the estimator's."""
    node, incoming, rows = gatherer.estimators[name], gatherer.incoming[name], gatherer.verdicts
    whole, nis = gatherer.estimates.extend, gatherer.nis.append
    states, covariances = gatherer.state.extend, gatherer.covariance.extend

    def take(form: Published) -> None:
        step, state, covariance = form.step, form.state, form.covariance
        size = state.size
        whole((node, step, form.refers_to, not size, form.nis_dof, size, covariance.size))
        nis(form.nis)
        states(state.tolist())
        covariances(covariance.ravel().tolist())
        for detection in form.detections:
            rows.link.append(incoming[detection.source])
            rows.step.append(step)
            rows.sequence.append(detection.sequence)
            rows.mark.append(bool(detection.alarm))
            rows.value.append(detection.statistic)
        if form.diagnostics and gatherer.speaks(tuple(form.diagnostics)):
            gatherer.take_diagnostics(name, form)

    return take
