"""One pass over a record: from messages to arrays."""

from __future__ import annotations

import math
import sys
from array import array
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import compress, pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bus import keys
from bus.integrity import Gate
from bus.messages import ChannelEvents, Estimate, Inbox, Message, Truth
from bus.packets import packets_of_inbox
from bus.plan import Plan
from orchestrator.errors import InputError

_IS_FALSE = {"attacked": True, "lost": False}
"""The acts of the channel on a packet that was sent: whether they falsify it or lose it."""

GUARANTEED = "bound_guaranteed"
"""The diagnostic by which a method says whether its covariance is a guaranteed bound: 0 in one step is no."""
SENT = "sent"
"""The diagnostic by which a method that asks its event trigger itself says what share was sent."""

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


class ScoreError(InputError):
    """The record does not fit its plan; the message says where."""


@dataclass(frozen=True)
class Estimates:
    """Estimates by (estimator, step of publication), N x K, in the plan's order; NaN where unknown.

    ``error`` (N, K, n) is the estimate less the truth of the step that it refers to. ``covariance`` is (N, K,
    n, n).
    """

    present: Bools
    declared_diverged: Bools
    error: Floats
    covariance: Floats
    nis: Floats
    nis_dof: Ints


@dataclass(frozen=True)
class Packets:
    """Rows that concern one packet each: ``link`` (its index in the plan, -1: none), ``step``, ``sequence``.

    ``mark`` is True for a verdict that raised the alarm and for an event that attacked (False: lost);
    ``stage`` is the index of the stage that acted (-1: not one of the plan). ``norm`` is the Euclidean norm
    of the payload of a delivery and of an injection (NaN: not told).
    """

    link: Ints
    step: Ints
    sequence: Ints
    mark: Bools
    stage: Ints
    norm: Floats


@dataclass(frozen=True)
class Gathered:
    """A record as arrays. ``counts`` (8, L) holds by link the packets that `COUNTS` names.

    ``deliveries`` are the packets that receivers let in, each filed under the link from its source; an
    injection stands under the link that it was made on, which may carry it in another node's name. ``slots``
    (L,) counts by link the slots that the channel passed. ``said_sent`` holds, by estimator whose method
    fills its slots for other reasons too, how many of its estimates said what share of its events was sent,
    and the sum of that. ``guaranteed`` tells, by estimator that says so, whether its bounds are guaranteed.
    """

    truth_present: Bools
    estimates: Estimates
    deliveries: Packets
    verdicts: Packets
    events: Packets
    injections: Packets
    counts: Ints
    slots: Ints
    said_sent: Mapping[str, tuple[int, float]]
    guaranteed: Mapping[str, bool]


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
        self.norm = array("d")

    def packets(self) -> Packets:
        """Return the rows as arrays; columns that were never filled are False or -1."""
        link, step, sequence = (_integers(column) for column in (self.link, self.step, self.sequence))
        mark = _integers(self.mark).astype(bool) if self.mark else np.zeros(link.size, dtype=bool)
        stage = _integers(self.stage) if self.stage else np.full(link.size, -1)
        norm = np.array(self.norm) if self.norm else np.full(link.size, np.nan)
        return Packets(link, step, sequence, mark, stage, norm)


def _integers(column: array[int]) -> Ints:
    return np.array(column, dtype=np.int64)


def _node(topic: str) -> str:
    return topic.split("/", 2)[1]


class _Gatherer:
    """Takes the messages of a record one by one, in any order."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self.estimators = _Index({estimator.name: i for i, estimator in enumerate(plan.estimators)})
        self.links = _Index({link.name: i for i, link in enumerate(plan.links)})
        self.stages = _Index({stage.label: i for i, stage in enumerate(plan.stages)})
        self.incoming: dict[str, _Index] = {name: _Index() for name in plan.node_names}
        for i, link in enumerate(plan.links):
            self.incoming[link.destination][link.source] = i
        self.truth: dict[int, list[float]] = {}
        self.estimates = array("q")  # seven numbers an estimate, see `take_estimate`
        self.state, self.covariance, self.nis = array("d"), array("d"), array("d")
        senders: dict[tuple[str, str], list[str]] = {}
        for link in plan.links:
            senders.setdefault((link.destination, keys.phase_of(link.stream)), []).append(link.source)
        self.gates = {place: Gate(plan, sources) for place, sources in senders.items()}
        self.deliveries, self.verdicts, self.events, self.injections = (_Rows() for _ in range(4))
        self.counted_link = array("q")
        self.counted = tuple(array("q") for _ in COUNTS[:-1])
        self.last_events: dict[tuple[str, int], ChannelEvents] = {}
        self.triggered = frozenset(plan.triggered)
        self.said_sent: dict[str, tuple[int, float]] = {}
        self.guaranteed: dict[str, bool] = {}

    def take_truth(self, topic: str, message: Truth) -> None:
        self.truth[message.step] = message.state

    def take_estimate(self, topic: str, message: Estimate) -> None:
        name, step = _node(topic), message.step
        sizes = len(message.state), len(message.covariance)
        node = self.estimators[name]
        self.estimates.extend((node, step, message.refers_to, message.diverged, message.nis_dof, *sizes))
        self.nis.append(message.nis)
        self.state.extend(message.state)
        self.covariance.extend(message.covariance)
        if name in self.triggered and SENT in message.diagnostic_name:
            share = message.diagnostic_value[message.diagnostic_name.index(SENT)]
            told, total = self.said_sent.get(name, (0, 0.0))
            self.said_sent[name] = told + 1, total + share
        if GUARANTEED in message.diagnostic_name:
            said = message.diagnostic_value[message.diagnostic_name.index(GUARANTEED)] > 0.0
            self.guaranteed[name] = said and self.guaranteed.get(name, True)
        if message.detector_source:
            incoming, rows = self.incoming[name], self.verdicts
            rows.link.extend(map(incoming.__getitem__, message.detector_source))
            rows.step.extend([step] * len(message.detector_source))
            rows.sequence.extend(message.detector_sequence)
            rows.mark.extend(message.detector_alarm)

    def take_inbox(self, topic: str, message: Inbox) -> None:
        if not message.source:
            return
        node, phase = topic.split("/")[1:3]
        rows, sources, sequences = self.deliveries, message.source, message.sequence
        norms = _norms(message)
        if self.plan.integrity or not self.incoming[node].keys() >= set(sources):
            gate = self.gates.get((node, phase))
            let_in = [gate is None or gate.admits(packet) for packet in packets_of_inbox(message)]
            sources, sequences = list(compress(sources, let_in)), list(compress(sequences, let_in))
            norms = list(compress(norms, let_in))
        rows.link.extend(map(self.incoming[node].__getitem__, sources))
        rows.step.extend([message.step] * len(sources))
        rows.sequence.extend(sequences)
        rows.norm.extend(norms)

    def take_events(self, topic: str, message: ChannelEvents) -> None:
        self.counted_link.extend(map(self.links.__getitem__, message.link))
        for total, name in zip(self.counted, COUNTS, strict=False):
            total.extend(getattr(message, name) or [0] * len(message.link))
        last = self.last_events.get((topic, message.round))
        if last is None or message.step > last.step:
            self.last_events[topic, message.round] = message
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
                rows.norm.append(size)
            else:
                continue
            rows.link.append(self.links[link])
            rows.step.append(message.step)
            rows.sequence.append(sequence)
            rows.stage.append(self.stages[stage])

    def finish(self) -> Gathered:
        truth = self._truth()
        return Gathered(
            truth_present=np.asarray(np.isfinite(truth).all(axis=1)),
            estimates=self._estimates(truth),
            deliveries=self.deliveries.packets(),
            verdicts=self.verdicts.packets(),
            events=self.events.packets(),
            injections=self.injections.packets(),
            counts=self._counts(),
            slots=np.bincount(_integers(self.counted_link), minlength=len(self.plan.links)),
            said_sent=self.said_sent,
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
        error[node[has], step[has]] = np.array(self.state).reshape(has.sum(), n) - reference[has]
        has = covariance_size > 0
        covariance[node[has], step[has]] = np.array(self.covariance).reshape(has.sum(), n, n)
        return Estimates(present, declared, error, covariance, nis, nis_dof)

    def _counts(self) -> Ints:
        link = _integers(self.counted_link)
        acts = (self.events, self.injections, self.deliveries)
        if min(link, default=0) < 0 or any(min(rows.link, default=0) < 0 for rows in acts):
            raise ScoreError("the record holds packets of a link that the plan does not have")
        for rows in acts:
            if rows.step and not (min(rows.step) >= 0 and max(rows.step) < self.plan.steps):
                raise ScoreError(f"the record holds packets of a step outside the plan's {self.plan.steps}")
        counts = np.zeros((len(COUNTS), len(self.plan.links)), dtype=np.int64)
        for row, column in zip(counts, self.counted, strict=False):
            np.add.at(row, link, _integers(column))
        for _, message in sorted(self.last_events.items()):
            left = message.in_flight or [0] * len(message.link)
            for name, count in zip(message.link, left, strict=True):
                counts[-1, self.links[name]] = count
        return counts


def _norms(message: Inbox) -> Sequence[float]:
    """Return the Euclidean norm of each payload of an inbox."""
    values = message.values
    bounds = pairwise([*message.offset, len(values)])
    return [min(math.hypot(*values[begin:end]), sys.float_info.max) for begin, end in bounds]


def gather(plan: Plan, records: Iterable[tuple[str, Message]]) -> Gathered:
    """Read a record once, whatever the order of the messages inside a step.

    Raises `ScoreError` when a message cannot belong to the plan.
    """
    gatherer = _Gatherer(plan)
    takers: dict[type[Message], Callable[[str, Any], None]] = {
        Truth: gatherer.take_truth,
        Estimate: gatherer.take_estimate,
        Inbox: gatherer.take_inbox,
        ChannelEvents: gatherer.take_events,
    }
    for topic, message in records:
        take = takers.get(type(message))
        if take is not None:
            take(topic, message)
    return gatherer.finish()
