"""One pass over a record: from messages to arrays."""

from __future__ import annotations

from array import array
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
from channel.happened import Happened
from nodes.published import Published
from orchestrator.score.attack_beliefs import AttackBeliefs, AttackListener
from orchestrator.score.columns import (
    COUNTS,
    MOST_LOOSE,
    Bools,
    Floats,
    Ints,
    Ledger,
    Packets,
    Payloads,
    Rows,
    ScoreError,
    integers,
)
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

_IS_FALSE = {"attacked": True, "lost": False}
"""The acts of the channel on a packet that was sent: whether they falsify it or lose it."""

GUARANTEED = "bound_guaranteed"
"""The diagnostic by which a method says whether its covariance is a guaranteed bound: 0 in one step is no."""
SENT = "sent"
"""The diagnostic by which a method that asks its event trigger itself says what share was sent."""
_AFTER_ESTIMATE = len(keys.estimate(""))
_REFUSED = -2
"""In the place of a link: the packet was not let in."""


@dataclass(frozen=True)
class Estimates:
    """Estimates by (estimator, step of publication), N x K, in the plan's order; NaN where unknown.

    ``state`` (N, K, n) is what was estimated of the step ``refers_to`` (N, K), ``error`` (N, K, n) that less
    the truth of that step. ``covariance`` is (N, K, n, n).
    """

    present: Bools
    declared_diverged: Bools
    refers_to: Ints
    state: Floats
    error: Floats
    covariance: Floats
    nis: Floats
    nis_dof: Ints


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


class _Index(dict[str, int]):
    """Indices by name; -1 for an unknown name."""

    def __missing__(self, name: str) -> int:
        return -1


class Gatherer:
    """Takes the messages of a record one by one, in any order; raises `ScoreError` for one that cannot be."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self.estimators = _Index({estimator.name: i for i, estimator in enumerate(plan.estimators)})
        self.links = _Index({link.name: i for i, link in enumerate(plan.links)})
        self.stages = _Index({stage.label: i for i, stage in enumerate(plan.stages)})
        self.inboxes: list[tuple[str, Inbox]] = []
        self.payloads = Payloads()
        self.incoming: dict[str, _Index] = {name: _Index() for name in plan.node_names}
        for i, link in enumerate(plan.links):
            self.incoming[link.destination][link.source] = i
        self.receivers = {
            keys.rx(link.destination, keys.phase_of(link.stream)): self.incoming[link.destination]
            for link in plan.links
        }
        self.told = {keys.rx(own.name, keys.CORRECT) for own in plan.estimators if own.oracles}
        self.false_data = FalseDataListener(plan)
        self.truth: dict[int, list[float]] = {}
        self.of_attacks = AttackListener()
        self.loose: list[tuple[str, Estimate]] = []
        self.estimates = array("q")  # rows of seven, see `_pack_estimates`
        self.speaking: dict[tuple[str, ...], bool] = {}
        self.state, self.covariance, self.nis = array("d"), array("d"), array("d")
        senders: dict[tuple[str, str], list[str]] = {}
        for link in plan.links:
            senders.setdefault((link.destination, keys.phase_of(link.stream)), []).append(link.source)
        self.gates = {place: Gate(plan, sources) for place, sources in senders.items()}
        self.deliveries, self.verdicts, self.events, self.injections = (Rows() for _ in range(4))
        self.ledgers: dict[tuple[str, int], Ledger] = {}
        self.all_ledgers: list[Ledger] = []
        self.measurements = MeasurementRows(plan)
        self.measuring = {keys.tx(own.name, keys.MEASUREMENT): own.name for own in plan.sensors}
        self.last_events: dict[tuple[str, int], ChannelEvents | Happened] = {}
        self.triggered = frozenset(plan.triggered)
        self.said_sent: dict[str, tuple[int, float]] = {}
        self.guaranteed: dict[str, bool] = {}
        self.takers: dict[type[Message], Callable[[str, Any], None]] = {
            Truth: self._take_truth,
            Estimate: self._take_estimate,
            Inbox: self._take_inbox,
            ChannelEvents: self.take_events,
            Transmission: self._take_sent,
        }

    def take(self, topic: str, message: Message) -> None:
        """Take a message; what no score needs is passed over."""
        take = self.takers.get(type(message))
        if take is not None:
            take(topic, message)

    def _take_truth(self, topic: str, message: Truth) -> None:
        self.truth[message.step] = message.state
        if message.attack:
            self.of_attacks.take_truth(message)

    def _take_estimate(self, topic: str, message: Estimate) -> None:
        name = topic[_AFTER_ESTIMATE:]
        self.loose.append((name, message))
        if message.diagnostic_name:
            self.take_diagnostics(name, message)
        if len(self.loose) >= MOST_LOOSE:
            self._pack_estimates()

    def speaks(self, names: tuple[str, ...]) -> bool:
        """Return whether diagnostics of these names say something that is listened to."""
        speaks = self.speaking.get(names)
        if speaks is None:
            speaks = any(name in (SENT, GUARANTEED, "a0") or name.startswith("attack_") for name in names)
            self.speaking[names] = speaks
        return speaks

    def take_diagnostics(self, name: str, message: Estimate | Published) -> None:
        """Take what an estimate's diagnostics say."""
        self.of_attacks.take_estimate(self.estimators[name], message)
        self.false_data.take_estimate(name, message)
        if name in self.triggered and SENT in message.diagnostic_name:
            share = message.diagnostic_value[message.diagnostic_name.index(SENT)]
            said, total = self.said_sent.get(name, (0, 0.0))
            self.said_sent[name] = said + 1, total + share
        if GUARANTEED in message.diagnostic_name:
            holds = message.diagnostic_value[message.diagnostic_name.index(GUARANTEED)] > 0.0
            self.guaranteed[name] = holds and self.guaranteed.get(name, True)

    def _take_sent(self, topic: str, message: Transmission) -> None:
        source = self.measuring.get(topic)
        if source is not None:
            self.take_measured(
                source, message.step, packets_of_transmission(message, source, keys.MEASUREMENT)
            )

    def take_measured(self, source: str, step: int, packets: Sequence[Packet]) -> None:
        """Take what a sensor sent in a step."""
        self.measurements.take_sent(source, step, packets)
        self.false_data.take_sent(source, step, packets)

    def _pack_estimates(self) -> None:
        """Pack the estimates' numbers; of many at once, for that takes a third of the time."""
        messages = [message for _, message in self.loose]
        nodes = [self.estimators[name] for name, _ in self.loose]
        columns: tuple[list[int], ...] = (
            nodes,
            [message.step for message in messages],
            [message.refers_to for message in messages],
            [message.diverged for message in messages],
            [message.nis_dof for message in messages],
            [len(message.state) for message in messages],
            [len(message.covariance) for message in messages],
        )
        self.estimates.extend(chain.from_iterable(zip(*columns, strict=True)))
        self.nis.extend([message.nis for message in messages])
        self.state.extend(chain.from_iterable([message.state for message in messages]))
        self.covariance.extend(chain.from_iterable([message.covariance for message in messages]))
        judging = [(self.incoming[name], own) for name, own in self.loose if own.detector_source]
        rows = self.verdicts
        rows.link.extend([links[source] for links, own in judging for source in own.detector_source])
        rows.step.extend([own.step for _, own in judging for _ in own.detector_source])
        rows.sequence.extend([number for _, own in judging for number in own.detector_sequence])
        rows.mark.extend([alarm for _, own in judging for alarm in own.detector_alarm])
        rows.value.extend([value for _, own in judging for value in own.detector_statistic])
        self.loose.clear()

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
                steps = [message.step] * len(packets)
                self.measurements.take_arrived(estimator, steps, packets, own, untouched=False)
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
        place = topic, message.round
        ledger = self.ledgers.get(place)
        if ledger is None or ledger.link != message.link:
            ledger = self.ledgers[place] = Ledger(topic, message.link)
            self.all_ledgers.append(ledger)
        ledger.take(message)
        last = self.last_events.get(place)
        if last is None or message.step > last.step:
            self.last_events[place] = message
        if message.event_link:
            self._take_acts(message)
            self.false_data.take_events(message)

    def _take_acts(self, message: ChannelEvents | Happened) -> None:
        columns = (message.event_link, message.event_stage, message.event_sequence, message.event_action)
        magnitudes = message.event_magnitude
        for link, stage, sequence, action, size in zip(*columns, magnitudes, strict=True):
            is_false = _IS_FALSE.get(action)
            if is_false is not None:
                rows = self.events
                rows.mark.append(is_false)
            elif action == "injected":
                rows = self.injections
                rows.value.append(size)
            else:
                continue
            rows.link.append(self.links[link])
            rows.step.append(message.step)
            rows.sequence.append(sequence)
            rows.stage.append(self.stages[stage])

    def finish(self) -> Gathered:
        """Return all that was taken."""
        truth, deliveries = self._truth(), self._delivered()
        estimates = self._estimates(truth)  # with which the verdicts are unpacked
        return Gathered(
            truth_present=np.asarray(np.isfinite(truth).all(axis=1)),
            estimates=estimates,
            deliveries=deliveries,
            verdicts=self.verdicts.packets(),
            events=self.events.packets(),
            injections=self.injections.packets(),
            counts=self._counts(deliveries),  # it checks what the next ones rely on
            slots=self._slots(),
            sent=self._sent(),
            measurements=self.measurements.finish(),
            attack_beliefs=self.of_attacks.beliefs(len(self.plan.estimators), self.plan.steps),
            said_sent=self.said_sent,
            false_data=self.false_data,
            guaranteed=self.guaranteed,
        )

    def _slots(self) -> Ints:
        slots = np.zeros(len(self.plan.links), dtype=np.int64)
        for ledger in self.all_ledgers:
            np.add.at(slots, [self.links[name] for name in ledger.link], len(ledger.step))
        return slots

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

    def _check(self, node: Ints, step: Ints, size: Ints, covariance_size: Ints, n: int) -> None:
        names = (*(estimator.name for estimator in self.plan.estimators), "an unknown estimator")
        faults = {
            "stands outside the plan": (node < 0) | (step < 0) | (step >= self.plan.steps),
            f"has a state of another size than the plant's {n}": (size != 0) & (size != n),
            f"has a covariance that is not {n} x {n}": (covariance_size != 0) & (covariance_size != n * n),
        }
        place = node * self.plan.steps + step
        first = np.zeros(place.size, dtype=bool)
        first[np.unique(place, return_index=True)[1]] = True
        faults["stands in the record twice"] = ~first
        for fault, where in faults.items():
            if where.any():
                at = int(np.argmax(where))
                raise ScoreError(f"the estimate of {names[node[at]]} at step {step[at]} {fault}")

    def _estimates(self, truth: Floats) -> Estimates:
        self._pack_estimates()
        rows = integers(self.estimates).reshape(-1, 7)
        node, step, refers_to, diverged, dof, size, covariance_size = rows.T.copy()
        (K, n), N = truth.shape, len(self.plan.estimators)
        self._check(node, step, size, covariance_size, n)
        present, declared = np.zeros((N, K), dtype=bool), np.zeros((N, K), dtype=bool)
        present[node, step] = True
        declared[node, step] = diverged.astype(bool)
        nis, nis_dof = np.full((N, K), np.nan), np.zeros((N, K), dtype=np.int64)
        nis[node, step], nis_dof[node, step] = np.array(self.nis), dof
        error, covariance = np.full((N, K, n), np.nan), np.full((N, K, n, n), np.nan)
        has = size > 0
        known = (refers_to >= 0) & (refers_to < K)
        reference = np.where(known[:, None], truth[np.where(known, refers_to, 0)], np.nan)
        state = np.full((N, K, n), np.nan)
        state[node[has], step[has]] = np.array(self.state).reshape(has.sum(), n)
        error[node[has], step[has]] = state[node[has], step[has]] - reference[has]
        refers = np.full((N, K), -1)
        refers[node, step] = refers_to
        has = covariance_size > 0
        covariance[node[has], step[has]] = np.array(self.covariance).reshape(has.sum(), n, n)
        return Estimates(present, declared, refers, state, error, covariance, nis, nis_dof)

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

    def _sent(self) -> Ints:
        """Return the slots with a packet by sender and step; one link of a sender tells for its stream."""
        senders = {name: i for i, name in enumerate(self.plan.node_names)}
        sent = np.zeros((len(senders), self.plan.steps), dtype=np.int64)
        for ledger in self.all_ledgers:
            if ledger.topic == keys.channel(keys.CONTROL) or not ledger.link:
                continue
            first: dict[str, int] = {}  # a column by sender
            for column, name in enumerate(ledger.link):
                first.setdefault(self.plan.links[self.links[name]].source, column)
            has_sent = ledger.table("sent")[:, list(first.values())] > 0
            rows = np.array([senders[name] for name in first], dtype=np.int64)
            np.add.at(sent, (rows[None, :], integers(ledger.step)[:, None]), has_sent)
        return sent

    def _counts(self, deliveries: Packets) -> Ints:
        """Return the counts by link; raises `ScoreError` for what the plan does not have."""
        names = [name for ledger in self.all_ledgers for name in ledger.link]
        acts = (self.events.packets(), self.injections.packets(), deliveries)
        if any(name not in self.links for name in names) or any((own.link < 0).any() for own in acts):
            raise ScoreError("the record holds packets of a link that the plan does not have")
        for step in (*(own.step for own in acts), *(integers(own.step) for own in self.all_ledgers)):
            if step.size and not (step.min() >= 0 and step.max() < self.plan.steps):
                raise ScoreError(f"the record holds packets of a step outside the plan's {self.plan.steps}")
        counts = np.zeros((len(COUNTS), len(self.plan.links)), dtype=np.int64)
        for ledger in self.all_ledgers:
            link = [self.links[name] for name in ledger.link]
            for row, name in zip(counts, ledger.counted, strict=False):
                np.add.at(row, link, ledger.table(name).sum(axis=0))
        for _, message in sorted(self.last_events.items()):
            left = message.in_flight or [0] * len(message.link)
            for name, count in zip(message.link, left, strict=True):
                counts[-1, self.links[name]] = count
        return counts


def gather(plan: Plan, records: Iterable[tuple[str, Message]]) -> Gathered:
    """Read a record once, whatever the order of the messages inside a step.

    Raises `ScoreError` when a message cannot belong to the plan.
    """
    gatherer = Gatherer(plan)
    for topic, message in records:
        gatherer.take(topic, message)
    return gatherer.finish()
