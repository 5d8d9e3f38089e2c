"""What is gathered where no record is kept: packets and beliefs as the programs have them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from bus.messages import TOPIC_TYPES, ChannelEvents, Estimate, Inbox
from bus.packets import Delivery, Sending
from nodes.published import Published
from orchestrator.score.gather import Gatherer


class Carried:
    """Lets a gatherer take forms, which are kept as they are until `pack` takes those of many steps."""

    def __init__(self, gatherer: Gatherer) -> None:
        self._gatherer = gatherer
        self._sent: dict[str, list[Sending]] = {}
        self._delivered: dict[str, list[Delivery]] = {}
        self._published: dict[str, list[Published]] = {}

    def taker(self, topic: str) -> Callable[[Any], None] | None:
        """Return what takes the forms of a topic, None when no score needs them."""
        root, name, *_ = topic.split("/")
        if TOPIC_TYPES[root] is Estimate:
            return self._published.setdefault(name, []).append
        if TOPIC_TYPES[root] is ChannelEvents:
            return partial(self._gatherer.take_events, topic)
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
        for name, beliefs in self._published.items():
            self._take_beliefs(name, beliefs)
            beliefs.clear()

    def _take_inboxes(self, topic: str, inboxes: list[Delivery]) -> None:
        gatherer = self._gatherer
        rows, incoming = gatherer.deliveries, gatherer.receivers[topic]
        hearer = gatherer.false_data.receivers.get(topic)
        estimator = gatherer.measurements.receivers.get(topic)
        packets = [packet for inbox in inboxes for packet in inbox.packets]
        links = [incoming[packet.source] for packet in packets]
        end = 0
        for inbox in inboxes:
            arrived = inbox.packets
            begin, end = end, end + len(arrived)
            if not inbox.untouched:
                links[begin:end] = gatherer.let_in(topic, arrived)
                gatherer.payloads.take(len(rows.link) + begin, arrived)
            if hearer is not None:
                gatherer.false_data.take_inbox(hearer, inbox.step, arrived)
        steps = [inbox.step for inbox in inboxes for _ in inbox.packets]
        if estimator is not None:
            untouched = all(inbox.untouched for inbox in inboxes)
            gatherer.measurements.take_arrived(estimator, steps, packets, links, untouched=untouched)
        rows.link.extend(links)
        rows.step.extend(steps)
        rows.sequence.extend([packet.sequence for packet in packets])

    def _take_beliefs(self, name: str, beliefs: list[Published]) -> None:
        gatherer = self._gatherer
        gatherer.estimates.take_beliefs(name, beliefs)
        for own in beliefs:
            if own.diagnostics and gatherer.speaks(tuple(own.diagnostics)):
                gatherer.take_diagnostics(name, own)
