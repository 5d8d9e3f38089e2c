"""One pass over a record: from messages to arrays."""

from __future__ import annotations

import math
import sys
from array import array
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bus import keys
from bus.integrity import Gate
from bus.messages import ChannelEvents, Estimate, Inbox, Message, Transmission, Truth
from bus.packets import packets_of_inbox
from bus.plan import Plan
from orchestrator.errors import InputError
from orchestrator.score.measurements import MeasurementRows, Measurements

_IS_FALSE = {"attacked": True, "lost": False}
"""The acts of the channel on a packet that was sent: whether they falsify it or lose it."""

_AFTER_ESTIMATE = len(keys.estimate(""))
_MOST_LOOSE = 20_000
_REFUSED = -2
"""In the place of a link: the packet was not let in."""

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


class ScoreError(InputError):
    """The record does not fit its plan; the message says where."""


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


@dataclass(frozen=True)
class Gathered:
    """A record as arrays. ``counts`` (8, L) holds by link the packets that `COUNTS` names.

    ``deliveries`` are the packets that receivers let in, each filed under the link from its source; an
    injection stands under the link that it was made on, which may carry it in another node's name. ``sent``
    (nodes, K) counts the slots with a packet that each node of the plan sent, measurements and exchanges.
    """

    truth_present: Bools
    estimates: Estimates
    deliveries: Packets
    verdicts: Packets
    events: Packets
    injections: Packets
    counts: Ints
    sent: Ints
    measurements: Measurements


COUNTS = ("sent", "lost", "attacked", "delivered", "injected", "duplicated", "refused", "in_flight")
"""What is counted by link: sums over the run, and of ``in_flight`` what was left at its end."""


class _Index(dict[str, int]):
    """Indices by name; -1 for an unknown name."""

    def __missing__(self, name: str) -> int:
        return -1


class _Rows:
    """Columns of `Packets` in the making."""

    def __init__(self) -> None:
        self.link, self.step, self.sequence, self.mark, self.stage = (array("q") for _ in range(5))
        self.value = array("d")

    def packets(self) -> Packets:
        """Return the rows as arrays; columns that were never filled are False or -1."""
        link, step, sequence = (_integers(column) for column in (self.link, self.step, self.sequence))
        mark = _integers(self.mark).astype(bool) if self.mark else np.zeros(link.size, dtype=bool)
        stage = _integers(self.stage) if self.stage else np.full(link.size, -1)
        value = np.array(self.value) if self.value else np.full(link.size, np.nan)
        return Packets(link, step, sequence, mark, stage, value)


def _integers(column: array[int]) -> Ints:
    return np.array(column, dtype=np.int64)


class _Payloads:
    """The payloads of all inboxes, end to end: their norms are wanted only where a packet was injected."""

    def __init__(self) -> None:
        self.inboxes = array("q")  # three numbers each: step, packets, values
        self.offset, self.values = array("q"), array("d")
        self._loose: list[list[float]] = []

    def take(self, message: Inbox) -> None:
        """Take an inbox that is not empty."""
        offset, values = message.offset, message.values
        self.inboxes.extend((message.step, len(offset), len(values)))
        self.offset.extend(offset)
        self._loose.append(values)
        if len(self._loose) >= _MOST_LOOSE:
            self._pack()

    def _pack(self) -> None:
        """Pack values, which takes time that most runs need not spend, into less memory."""
        self.values.extend(chain.from_iterable(self._loose))
        self._loose.clear()

    def steps(self) -> Ints:
        """Return the step of every packet."""
        step, packets, _ = _integers(self.inboxes).reshape(-1, 3).T
        return np.repeat(step, packets)

    def norms(self, wanted: Bools) -> Floats:
        """Return the Euclidean norm of each packet's payload that is wanted; NaN of the others."""
        _, packets, size = _integers(self.inboxes).reshape(-1, 3).T
        begin = np.repeat(np.cumsum(size) - size, packets) + _integers(self.offset)
        last = np.cumsum(packets) - 1
        end = np.append(begin[1:], 0)
        end[last] = np.cumsum(size)
        norms = np.full(begin.size, np.nan)
        if not wanted.any():
            return norms
        self._pack()
        values, largest = self.values, sys.float_info.max
        for i in np.flatnonzero(wanted).tolist():
            norms[i] = min(math.hypot(*values[begin[i] : end[i]]), largest)
        return norms


class _Ledger:
    """The counts of one phase and round, step by step, of the links that its events name."""

    __slots__ = ("counted", "link", "step", "topic")

    def __init__(self, topic: str, link: Sequence[str]) -> None:
        self.topic = topic
        self.link = link
        self.step = array("q")
        self.counted: dict[str, array[int]] = {name: array("q") for name in COUNTS[:-1]}

    def take(self, message: ChannelEvents) -> None:
        """Take the counts of one step; those that a message leaves out are zero on every link."""
        self.step.append(message.step)
        counted = self.counted
        counted["sent"].extend(message.sent)
        counted["lost"].extend(message.lost)
        counted["attacked"].extend(message.attacked)
        counted["delivered"].extend(message.delivered)
        if message.injected:
            counted["injected"].extend(message.injected)
        if message.duplicated:
            counted["duplicated"].extend(message.duplicated)
        if message.refused:
            counted["refused"].extend(message.refused)

    def table(self, name: str) -> Ints:
        """Return a count by step and link; the steps of one that is often left out are not told."""
        column = _integers(self.counted[name])
        width = len(self.link)
        if column.size % width if width else column.size:
            raise ScoreError(f"the channel's counts in {self.topic} do not fit its links")
        return column.reshape(column.size // max(width, 1), width)


class Gatherer:
    """Takes the messages of a record one by one, in any order; raises `ScoreError` for one that cannot be."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self.estimators = _Index({estimator.name: i for i, estimator in enumerate(plan.estimators)})
        self.links = _Index({link.name: i for i, link in enumerate(plan.links)})
        self.stages = _Index({stage.label: i for i, stage in enumerate(plan.stages)})
        self.known: dict[tuple[str, ...], array[int]] = {}
        self.payloads = _Payloads()
        self.incoming: dict[str, _Index] = {name: _Index() for name in plan.node_names}
        for i, link in enumerate(plan.links):
            self.incoming[link.destination][link.source] = i
        self.truth: dict[int, list[float]] = {}
        self.estimates = array("q")  # seven numbers an estimate, see `_take_estimate`
        self.state, self.covariance, self.nis = array("d"), array("d"), array("d")
        senders: dict[tuple[str, str], list[str]] = {}
        for link in plan.links:
            senders.setdefault((link.destination, keys.phase_of(link.stream)), []).append(link.source)
        self.gates = {place: Gate(plan, sources) for place, sources in senders.items()}
        self.deliveries, self.verdicts, self.events, self.injections = (_Rows() for _ in range(4))
        self.ledgers: dict[tuple[str, int], _Ledger] = {}
        self.all_ledgers: list[_Ledger] = []
        self.measurements = MeasurementRows(plan)
        self.last_events: dict[tuple[str, int], ChannelEvents] = {}
        self.takers: dict[type[Message], Callable[[str, Any], None]] = {
            Truth: self._take_truth,
            Estimate: self._take_estimate,
            Inbox: self._take_inbox,
            ChannelEvents: self._take_events,
            Transmission: self.measurements.take_sent,
        }

    def take(self, topic: str, message: Message) -> None:
        """Take a message; what no score needs is passed over."""
        take = self.takers.get(type(message))
        if take is not None:
            take(topic, message)

    def _take_truth(self, topic: str, message: Truth) -> None:
        self.truth[message.step] = message.state

    def _take_estimate(self, topic: str, message: Estimate) -> None:
        name, step = topic[_AFTER_ESTIMATE:], message.step
        state, covariance = message.state, message.covariance
        self.estimates.extend(
            (
                self.estimators[name],
                step,
                message.refers_to,
                message.diverged,
                message.nis_dof,
                len(state),
                len(covariance),
            )
        )
        self.nis.append(message.nis)
        self.state.extend(state)
        self.covariance.extend(covariance)
        if message.detector_source:
            incoming, rows = self.incoming[name], self.verdicts
            rows.link.extend(map(incoming.__getitem__, message.detector_source))
            rows.step.extend([step] * len(message.detector_source))
            rows.sequence.extend(message.detector_sequence)
            rows.mark.extend(message.detector_alarm)
            rows.value.extend(message.detector_statistic)

    def _take_inbox(self, topic: str, message: Inbox) -> None:
        if not message.source:
            return
        place = (topic, *message.source)
        links = self.known.get(place)
        if links is None:
            links = self.known[place] = self._links_into(topic, message.source)
        if not links:
            links = self._let_in(topic, message)
        rows = self.deliveries
        rows.link.extend(links)
        rows.sequence.extend(message.sequence)
        self.payloads.take(message)
        self.measurements.take_inbox(topic, message, links)

    def _links_into(self, topic: str, sources: Sequence[str]) -> array[int]:
        """Return the links from some sources into an inbox; none when each packet must be looked at."""
        incoming = self.incoming[topic.split("/")[1]]
        if self.plan.integrity or not incoming.keys() >= set(sources):
            return array("q")
        return array("q", map(incoming.__getitem__, sources))

    def _let_in(self, topic: str, message: Inbox) -> array[int]:
        """Return the links of an inbox's packets, `_REFUSED` for those that the receiver does not let in."""
        node, phase = topic.split("/")[1:3]
        gate, incoming = self.gates.get((node, phase)), self.incoming[node]
        return array(
            "q",
            [
                incoming[packet.source] if gate is None or gate.admits(packet) else _REFUSED
                for packet in packets_of_inbox(message)
            ],
        )

    def _take_events(self, topic: str, message: ChannelEvents) -> None:
        place = topic, message.round
        ledger = self.ledgers.get(place)
        if ledger is None or ledger.link != message.link:
            ledger = self.ledgers[place] = _Ledger(topic, message.link)
            self.all_ledgers.append(ledger)
        ledger.take(message)
        last = self.last_events.get(place)
        if last is None or message.step > last.step:
            self.last_events[place] = message
        if message.event_link:
            self._take_acts(message)

    def _take_acts(self, message: ChannelEvents) -> None:
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
        return Gathered(
            truth_present=np.asarray(np.isfinite(truth).all(axis=1)),
            estimates=self._estimates(truth),
            deliveries=deliveries,
            verdicts=self.verdicts.packets(),
            events=self.events.packets(),
            injections=self.injections.packets(),
            counts=self._counts(deliveries),  # it checks what the next one relies on
            sent=self._sent(),
            measurements=self.measurements.finish(),
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
        columns = _integers(self.estimates).reshape(-1, 7).T
        node, step, refers_to, diverged, dof, size, covariance_size = columns
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
        rows = self.deliveries
        link, sequence = _integers(rows.link), _integers(rows.sequence)
        let_in = link != _REFUSED
        false, mark = {*self.injections.sequence}, np.zeros(link.size, dtype=bool)
        wanted = let_in & np.isin(sequence, list(false)) if false else mark
        columns = link, self.payloads.steps(), sequence, mark, np.full(link.size, -1)
        return Packets(*(column[let_in] for column in (*columns, self.payloads.norms(wanted))))

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
            np.add.at(sent, (rows[None, :], _integers(ledger.step)[:, None]), has_sent)
        return sent

    def _counts(self, deliveries: Packets) -> Ints:
        """Return the counts by link; raises `ScoreError` for what the plan does not have."""
        names = [name for ledger in self.all_ledgers for name in ledger.link]
        acts = (self.events.packets(), self.injections.packets(), deliveries)
        if any(name not in self.links for name in names) or any((own.link < 0).any() for own in acts):
            raise ScoreError("the record holds packets of a link that the plan does not have")
        for step in (*(own.step for own in acts), *(_integers(own.step) for own in self.all_ledgers)):
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
