"""One pass over a record: from messages to arrays."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from itertools import accumulate, chain
from typing import Any

import numpy as np

from bus import keys
from bus.integrity import Gate
from bus.messages import ChannelEvents, Estimate, Inbox, Message, Transmission, Truth
from bus.packets import ORACLE, Packet, packets_of_inbox, packets_of_transmission
from bus.plan import Plan
from channel.contract import ATTACKED, INJECTED, LOST, Event
from channel.happened import Happened, events_of
from orchestrator.score.accounts import Accounts
from orchestrator.score.attack_beliefs import AttackBeliefs, AttackListener
from orchestrator.score.columns import (
    COUNTS,
    MOST_LOOSE,
    Bools,
    Floats,
    Index,
    Ints,
    Packets,
    Payloads,
    Rows,
    ScoreError,
)
from orchestrator.score.estimates import EstimateRows, Estimates
from orchestrator.score.measurements import MeasurementRows, Measurements
from orchestrator.score.recovered import FalseDataListener

__all__ = [
    "COUNTS",
    "Bools",
    "Estimates",
    "Floats",
    "Gathered",
    "Gatherer",
    "Ints",
    "Packets",
    "ScoreError",
    "gather",
]

_IS_FALSE = {ATTACKED: True, LOST: False}
"""The acts of the channel on a packet that was sent: whether they falsify it or lose it."""

GUARANTEED = "bound_guaranteed"
"""The diagnostic by which a method says whether its covariance is a guaranteed bound: 0 in one step is no."""
SENT = "sent"
"""The diagnostic by which a method that asks its event trigger itself says what share was sent."""
_AFTER_ESTIMATE = len(keys.estimate(""))
_REFUSED = -2
"""In the place of a link: the packet was not let in."""


@dataclass(frozen=True)
class Gathered:
    """A record as arrays. ``counts`` (8, L) holds by link the packets that `COUNTS` names.

    ``deliveries`` are the packets that receivers let in, each filed under the link from its source; an
    injection stands under the link that it was made on, which may carry it in another node's name. ``slots``
    (L,) counts by link the slots that the channel passed. ``said_sent`` holds, by estimator whose method
    fills its slots for other reasons too, how many of its estimates said what share of its events was sent,
    and the sum of that. ``sent`` (nodes, K) counts the slots with a packet that each node of the plan sent,
    measurements and exchanges. ``guaranteed`` tells, by estimator that says so, whether its bounds are
    guaranteed.
    """

    truth_present: Bools
    estimates: Estimates
    deliveries: Packets
    verdicts: Packets
    events: Packets
    injections: Packets
    counts: Ints
    attack_beliefs: AttackBeliefs
    slots: Ints
    said_sent: Mapping[str, tuple[int, float]]
    guaranteed: Mapping[str, bool]
    false_data: FalseDataListener
    sent: Ints
    measurements: Measurements


class Gatherer:
    """Takes the messages of a record one by one, in any order; raises `ScoreError` for one that cannot be."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self.links = Index({link.name: i for i, link in enumerate(plan.links)})
        self.stages = Index({stage.label: i for i, stage in enumerate(plan.stages)})
        self.inboxes: list[tuple[str, Inbox]] = []
        self.payloads = Payloads()
        self.incoming: dict[str, Index] = {name: Index() for name in plan.node_names}
        for i, link in enumerate(plan.links):
            self.incoming[link.destination][link.source] = i
        self.told = {keys.rx(own.name, keys.CORRECT) for own in plan.estimators if own.oracles}
        self.false_data = FalseDataListener(plan)
        self.truth: dict[int, list[float]] = {}
        self.of_attacks = AttackListener()
        self.speaking: dict[tuple[str, ...], bool] = {}
        senders: dict[tuple[str, str], list[str]] = {}
        for link in plan.links:
            senders.setdefault((link.destination, keys.phase_of(link.stream)), []).append(link.source)
        self.gates = {place: Gate(plan, sources) for place, sources in senders.items()}
        self.deliveries, self.verdicts, self.events, self.injections = (Rows() for _ in range(4))
        self.estimates = EstimateRows(plan, self.incoming, self.verdicts)
        self.accounts = Accounts(plan, self.links)
        self.measurements = MeasurementRows(plan)
        self.measuring = {
            keys.tx(own.name, keys.MEASUREMENT): (own.name, self._sender(own.name)) for own in plan.sensors
        }
        self.triggered = frozenset(plan.triggered)
        self.said_sent: dict[str, tuple[int, float]] = {}
        self.guaranteed: dict[str, bool] = {}

    def take(self, topic: str, message: Message) -> None:
        """Take a message; what no score needs is passed over."""
        take = _TAKERS.get(type(message))
        if take is not None:
            take(self, topic, message)

    def _take_truth(self, topic: str, message: Truth) -> None:
        self.truth[message.step] = message.state
        if message.attack:
            self.of_attacks.take_truth(message)

    def _take_estimate(self, topic: str, message: Estimate) -> None:
        name = topic[_AFTER_ESTIMATE:]
        self.estimates.take(name, message)
        if message.diagnostic_name:
            said = dict(zip(message.diagnostic_name, message.diagnostic_value, strict=True))
            self.take_diagnostics(name, message.step, message.refers_to, said)

    def take_diagnostics(self, name: str, step: int, refers_to: int, said: Mapping[str, float]) -> None:
        """Take what an estimate's diagnostics say; of most names nobody listens to any."""
        names = tuple(said)
        speaks = self.speaking.get(names)
        if speaks is None:
            speaks = any(name in (SENT, GUARANTEED, "a0") or name.startswith("attack_") for name in names)
            self.speaking[names] = speaks
        if not speaks:
            return
        self.of_attacks.take_diagnostics(self.estimates.index[name], step, refers_to, said)
        self.false_data.take_diagnostics(name, step, said)
        if name in self.triggered and SENT in said:
            times, total = self.said_sent.get(name, (0, 0.0))
            self.said_sent[name] = times + 1, total + said[SENT]
        if GUARANTEED in said:
            self.guaranteed[name] = said[GUARANTEED] > 0.0 and self.guaranteed.get(name, True)

    def _take_sent(self, topic: str, message: Transmission) -> None:
        measuring = self.measuring.get(topic)
        if measuring is not None:
            source, take = measuring
            take(message.step, packets_of_transmission(message, source, keys.MEASUREMENT))

    def _sender(self, source: str) -> Callable[[int, Sequence[Packet]], None]:
        """Return what takes what a sensor sent in a step."""
        keep = self.measurements.sender(source)
        if source not in self.false_data.sources:
            return keep
        keep_too = self.false_data.take_sent  # and not self: whoever holds itself is hard to let go

        def take(step: int, packets: Sequence[Packet]) -> None:
            keep(step, packets)
            keep_too(source, step, packets)

        return take

    def _take_inbox(self, topic: str, message: Inbox) -> None:
        if message.source:
            node = self.false_data.receivers.get(topic)
            if node is not None:
                self.false_data.take_inbox(node, message.step, packets_of_inbox(message))
            self.inboxes.append((topic, message))
            if len(self.inboxes) >= MOST_LOOSE:
                self._pack_inboxes(with_values=True)

    def _pack_inboxes(self, *, with_values: bool) -> None:
        """Pack what inboxes say of many at once; values take long, and only injections ask for them."""
        held = [message for _, message in self.inboxes]
        rows = self.deliveries
        links = self._links()
        rows.link.extend(links)
        rows.step.extend([message.step for message in held for _ in message.source])
        rows.sequence.extend(chain.from_iterable([message.sequence for message in held]))
        ends = accumulate(len(message.source) for message in held)
        for (topic, message), end in zip(self.inboxes, ends, strict=True):
            estimator = self.measurements.receivers.get(topic)
            if estimator is not None:
                packets, own = packets_of_inbox(message), links[end - len(message.source) : end]
                self.measurements.take_arrived(estimator, message.step, packets, own)
        if with_values:
            place = len(rows.link) - len(links)
            for message in held:
                self.payloads.take(place, packets_of_inbox(message))
                place += len(message.source)
        self.inboxes.clear()

    def _links(self) -> Sequence[int]:
        """Return the link of every packet of the loose inboxes, `_REFUSED` for those that are not let in."""
        incoming = {topic: self.incoming[topic.split("/")[1]] for topic, _ in self.inboxes}
        if not self.plan.integrity and not self.told:
            links = [incoming[topic][source] for topic, message in self.inboxes for source in message.source]
            if min(links, default=0) >= 0:
                return links
        return [
            link for topic, message in self.inboxes for link in self.let_in(topic, packets_of_inbox(message))
        ]

    def let_in(self, topic: str, packets: Sequence[Packet]) -> list[int]:
        """Return the links of one inbox's packets, `_REFUSED` for one that is not let in."""
        node, phase = topic.split("/")[1:3]
        gate, incoming = self.gates.get((node, phase)), self.incoming[node]
        return [
            incoming[packet.source]
            if packet.kind != ORACLE and (gate is None or gate.admits(packet))
            else _REFUSED
            for packet in packets
        ]

    def take_events(self, topic: str, message: ChannelEvents | Happened) -> None:
        """Take what happened in the channel."""
        self.accounts.take(topic, message)
        events = events_of(message)
        if events:
            self._take_acts(message.step, events)
            self.false_data.take_events(message.step, events)

    def _take_acts(self, step: int, events: Sequence[Event]) -> None:
        acts = [event for event in events if event.action in _IS_FALSE]
        made = [event for event in events if event.action == INJECTED]
        self.events.mark.extend([_IS_FALSE[event.action] for event in acts])
        self.injections.value.extend([event.magnitude for event in made])
        links, stages = self.links, self.stages
        for rows, own in ((self.events, acts), (self.injections, made)):
            if own:
                link, stage, sequence, _, _ = zip(*own, strict=True)
                rows.link.extend(map(links.__getitem__, link))
                rows.step.extend([step] * len(own))
                rows.sequence.extend(sequence)
                rows.stage.extend(map(stages.__getitem__, stage))

    def finish(self) -> Gathered:
        """Return all that was taken."""
        truth, deliveries = self._truth(), self._delivered()
        estimates = self.estimates.finish(truth)  # with which the verdicts are unpacked
        events, injections = self.events.packets(), self.injections.packets()
        return Gathered(
            truth_present=np.asarray(np.isfinite(truth).all(axis=1)),
            estimates=estimates,
            deliveries=deliveries,
            verdicts=self.verdicts.packets(),
            events=events,
            injections=injections,
            counts=self.accounts.counts(
                events, injections, deliveries
            ),  # it checks what the next ones rely on
            slots=self.accounts.slots(),
            sent=self.accounts.sent(),
            measurements=self.measurements.finish(),
            attack_beliefs=self.of_attacks.beliefs(len(self.plan.estimators), self.plan.steps),
            said_sent=self.said_sent,
            false_data=self.false_data,
            guaranteed=self.guaranteed,
        )

    def _truth(self) -> Floats:
        sizes = {len(state) for state in self.truth.values()} or {0}
        if len(sizes) > 1 or any(not 0 <= step < self.plan.steps for step in self.truth):
            raise ScoreError(
                f"the truth does not fit {self.plan.steps} steps of one dimension: {sorted(sizes)}"
            )
        truth = np.full((self.plan.steps, sizes.pop()), np.nan)
        for step, state in self.truth.items():
            truth[step] = state
        return truth

    def _delivered(self) -> Packets:
        """Return the deliveries; a norm is told where an injection has the packet's receiver and number."""
        self._pack_inboxes(with_values=bool(self.injections.link))
        rows = self.deliveries.packets()
        let_in = rows.link != _REFUSED
        if self.injections.link:
            wanted = let_in & np.isin(rows.sequence, list({*self.injections.sequence}))
            rows = replace(rows, value=self.payloads.norms(wanted))
        kept = np.flatnonzero(let_in)
        kept = kept[np.argsort(rows.step[kept], kind="stable")]  # they were taken receiver by receiver
        return Packets(*(getattr(rows, field.name)[kept] for field in fields(rows)))


_TAKERS: Mapping[type[Message], Callable[[Gatherer, str, Any], None]] = {
    Truth: Gatherer._take_truth,
    Estimate: Gatherer._take_estimate,
    Inbox: Gatherer._take_inbox,
    ChannelEvents: Gatherer.take_events,
    Transmission: Gatherer._take_sent,
}


def gather(plan: Plan, records: Iterable[tuple[str, Message]]) -> Gathered:
    """Read a record once, whatever the order of the messages inside a step.

    Raises `ScoreError` when a message cannot belong to the plan.
    """
    gatherer = Gatherer(plan)
    for topic, message in records:
        gatherer.take(topic, message)
    return gatherer.finish()
