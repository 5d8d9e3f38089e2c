"""What is gathered where no record is kept: packets and beliefs as the programs have them.

Most packets reach their receivers untouched, as the channel's counts tell: only the others are looked at one
by one.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from bus import keys
from bus.messages import TOPIC_TYPES, ChannelEvents, Estimate, Inbox
from bus.packets import Delivery, Sending
from bus.plan import Plan
from nodes.published import Published
from orchestrator.score.columns import Bools, Ledger, integers, whole
from orchestrator.score.gather import Gatherer

Taker = Callable[[Any], None]


class Carried:
    """Lets a gatherer take forms; `complete` adds what need not be looked at, when all have been taken."""

    def __init__(self, plan: Plan, gatherer: Gatherer) -> None:
        self._plan = plan
        self._gatherer = gatherer
        self._rounds = {own.name: own.rounds for own in plan.estimators}
        self._most_rounds = max(self._rounds.values(), default=1)
        self._slots = array("q")
        """By delivery that was looked at: its step and round, as one number."""
        self._touched: dict[tuple[str, int], list[int]] = {}
        """The steps of the inboxes that were looked at, by topic and round."""

    def taker(self, topic: str) -> Taker | None:
        """Return what takes the forms of a topic, None when no score needs them."""
        root, name, *_ = topic.split("/")
        kind = TOPIC_TYPES[root]
        if kind is Estimate:
            return self._take_beliefs_of(name)
        if kind is ChannelEvents:
            return partial(self._gatherer.take_events, topic)
        if kind is Inbox:
            return self._take_inboxes_of(topic)
        return self._take_slots_of(topic)

    def _take_beliefs_of(self, name: str) -> Taker:
        gatherer = self._gatherer
        take_belief = gatherer.estimates.taker(name)

        def take(own: Published) -> None:
            take_belief(own)
            if own.diagnostics:
                gatherer.take_diagnostics(name, own.step, own.refers_to, own.diagnostics)

        return take

    def _take_slots_of(self, topic: str) -> Taker | None:
        measuring = self._gatherer.measuring.get(topic)
        if measuring is None:
            return None
        _, take_sent = measuring

        def take(slot: Sending) -> None:
            take_sent(slot.step, slot.packets)

        return take

    def _take_inboxes_of(self, topic: str) -> Taker:
        def take(inbox: Delivery) -> None:
            if not inbox.untouched:
                self._take_touched(topic, inbox)

        return take

    def _take_touched(self, topic: str, inbox: Delivery) -> None:
        gatherer, step, arrived = self._gatherer, inbox.step, inbox.packets
        rows = gatherer.deliveries
        links = gatherer.let_in(topic, arrived)
        gatherer.payloads.take(len(rows.link), arrived)
        hearer = gatherer.false_data.receivers.get(topic)
        if hearer is not None:
            gatherer.false_data.take_inbox(hearer, step, arrived)
        estimator = gatherer.measurements.receivers.get(topic)
        if estimator is not None:
            gatherer.measurements.take_arrived(estimator, step, arrived, links)
        rows.link.extend(links)
        rows.step.extend([step] * len(links))
        rows.sequence.extend([packet.sequence for packet in arrived])
        self._slots.extend([step * self._most_rounds + inbox.round] * len(links))
        self._touched.setdefault((topic, inbox.round), []).append(step)

    def complete(self) -> None:
        """Add the packets of all inboxes that were not looked at; each bears the number of its slot."""
        gatherer, rows = self._gatherer, self._gatherer.deliveries
        rounds = np.array([self._rounds.get(link.source, 1) for link in self._plan.links], dtype=np.int64)
        looked_at = integers(rows.link), integers(rows.step), integers(rows.sequence), integers(self._slots)
        columns = [looked_at]
        for ledger in gatherer.accounts.ledgers:
            row, column = np.nonzero(self._untouched(ledger))
            link = np.array([gatherer.links[name] for name in ledger.link], dtype=np.int64)[column]
            step = integers(ledger.step)[row]
            slot = step * self._most_rounds + ledger.round
            columns.append((link, step, step * rounds[link] + ledger.round, slot))
            if ledger.topic == keys.channel(keys.CORRECT):
                gatherer.measurements.take_untouched(link, step)
        link, step, sequence, slot = (np.concatenate(column) for column in zip(*columns, strict=True))
        order = np.argsort(slot, kind="stable")
        rows.link, rows.step, rows.sequence = (whole(column[order]) for column in (link, step, sequence))
        gatherer.payloads.move(np.argsort(order))

    def _untouched(self, ledger: Ledger) -> Bools:
        """Return which links delivered, by row and column of a ledger, into inboxes not looked at."""
        phase = ledger.topic.removeprefix(keys.channel(""))
        delivered = np.asarray(ledger.table("delivered") > 0)
        into: dict[str, list[int]] = {}
        for column, name in enumerate(ledger.link):
            into.setdefault(self._plan.links[self._gatherer.links[name]].destination, []).append(column)
        row = {step: number for number, step in enumerate(ledger.step)}
        for receiver, columns in into.items():
            touched = self._touched.get((keys.rx(receiver, phase), ledger.round))
            if touched:
                delivered[np.ix_([row[step] for step in touched], columns)] = False
        return delivered
