"""The canonical order of a run's messages, and what each of them waits for. Pure functions of the plan.

A step holds its messages in the order in which they come about: truth, measurements, what the channel made of
them, the exchange rounds, estimates; within one kind, by topic. So every log of a plan has one order, however
its messages came.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

from bus import keys
from bus.grants import CHANNEL
from bus.plan import LinkPlan, Plan


class Slot(NamedTuple):
    """One message of a step: its topic, and its exchange round (0 outside of exchanges)."""

    topic: str
    round: int


def owner(topic: str) -> str:
    """Return the node that publishes a topic, or `CHANNEL`."""
    kind, _, rest = topic.partition("/")
    return CHANNEL if kind in {"rx", "channel"} else rest.partition("/")[0]


def _sources(links: Iterable[LinkPlan]) -> dict[str, list[str]]:
    """Return the senders to each receiver, sorted."""
    sources: dict[str, list[str]] = {}
    for link in sorted(links, key=lambda link: (link.destination, link.source)):
        sources.setdefault(link.destination, []).append(link.source)
    return sources


def _by_topic(slots: Mapping[Slot, tuple[Slot, ...]]) -> dict[Slot, tuple[Slot, ...]]:
    return dict(sorted(slots.items()))


def _measurements(plan: Plan) -> dict[Slot, tuple[Slot, ...]]:
    """Return truth, measurements and the inboxes of `keys.CORRECT`, each with what it waits for."""
    truth = Slot(keys.truth(plan.plant.name), 0)
    sent = {Slot(keys.tx(sensor.name, keys.MEASUREMENT), 0): (truth,) for sensor in plan.sensors}
    links = plan.links_of(keys.MEASUREMENT)
    received = {
        Slot(keys.rx(receiver, keys.CORRECT), 0): tuple(
            Slot(keys.tx(source, keys.MEASUREMENT), 0) for source in sources
        )
        for receiver, sources in _sources(links).items()
    }
    heard = sorted({Slot(keys.tx(link.source, keys.MEASUREMENT), 0) for link in links})
    events = {Slot(keys.channel(keys.CORRECT), 0): tuple(heard)} if heard else {}
    return {truth: (), **_by_topic(sent), **events, **_by_topic(received)}


def _exchanges(plan: Plan, last: dict[str, tuple[Slot, ...]]) -> dict[Slot, tuple[Slot, ...]]:
    """Return the messages of all exchange rounds, each with what it waits for.

    ``last`` is what each estimator's next message waits for; it is moved on to the last round.
    """
    rounds = {estimator.name: estimator.rounds for estimator in plan.estimators}
    links = plan.links_of(keys.EXCHANGE)
    heard = {link.source for link in links}
    slots: dict[Slot, tuple[Slot, ...]] = {}
    for round_ in range(max(rounds.values(), default=0)):
        active = {name for name, count in rounds.items() if count > round_}
        sent = {Slot(keys.tx(name, keys.EXCHANGE), round_): last[name] for name in heard & active}
        received = {
            receiver: tuple(Slot(keys.tx(source, keys.EXCHANGE), round_) for source in sources)
            for receiver, sources in _sources(link for link in links if link.source in active).items()
            if receiver in active
        }
        inboxes = {Slot(keys.rx(name, keys.EXCHANGE), round_): needs for name, needs in received.items()}
        events = {Slot(keys.channel(keys.EXCHANGE), round_): tuple(sorted(sent))} if sent else {}
        slots |= {**_by_topic(sent), **events, **_by_topic(inboxes)}
        last.update({owner(slot.topic): (slot,) for slot in sent})
        last.update({name: (Slot(keys.rx(name, keys.EXCHANGE), round_),) for name in received})
    return slots


def dependencies(plan: Plan) -> dict[Slot, tuple[Slot, ...]]:
    """Return every message of a step in canonical order, with what it waits for in the same step.

    A message that waits for none there waits only for its owner's work on the step before.
    """
    slots = _measurements(plan)
    names = [estimator.name for estimator in plan.estimators]
    inboxes = {name: Slot(keys.rx(name, keys.CORRECT), 0) for name in names}
    last: dict[str, tuple[Slot, ...]] = {
        name: (inbox,) if inbox in slots else () for name, inbox in inboxes.items()
    }
    slots |= _exchanges(plan, last)
    estimates = {Slot(keys.estimate(name), 0): needs for name, needs in last.items()}
    return {**slots, **_by_topic(estimates), **_controls(plan), **_watches(plan)}


def _controls(plan: Plan) -> dict[Slot, tuple[Slot, ...]]:
    """Return the controllers' inputs and the inboxes of `keys.CONTROL`, each with what it waits for."""
    sent = {
        Slot(keys.tx(own.name, keys.CONTROL), 0): (Slot(keys.estimate(own.estimator), 0),)
        for own in plan.controllers
    }
    received = {
        Slot(keys.rx(receiver, keys.CONTROL), 0): tuple(
            Slot(keys.tx(source, keys.CONTROL), 0) for source in sources
        )
        for receiver, sources in _sources(plan.links_of(keys.CONTROL)).items()
    }
    events = {Slot(keys.channel(keys.CONTROL), 0): tuple(sorted(sent))} if received else {}
    return {**_by_topic(sent), **events, **_by_topic(received)}


def _watches(plan: Plan) -> dict[Slot, tuple[Slot, ...]]:
    """Return what nodes tell the channel's triggers, each with what it waits for."""
    plant = plan.plant.name
    return {
        Slot(keys.tx(node, keys.WATCH), 0): (
            Slot(keys.truth(node) if node == plant else keys.estimate(node), 0),
        )
        for node in plan.watched
    }


def silent_from(plan: Plan, slot: Slot) -> int:
    """Return the first step in which a message is not sent any more; the number of steps when it always is.

    What the channel sends is always sent: it makes empty slots for a silent node.
    """
    sender = owner(slot.topic)
    return plan.steps if sender == CHANNEL else plan.silent_from(sender)


def canonical_order(plan: Plan) -> tuple[Slot, ...]:
    """Return every message of a step, in the order in which the log holds them."""
    return tuple(dependencies(plan))


def canonical_topics(plan: Plan) -> tuple[str, ...]:
    """Return every topic of a run, in the order in which the log registers them."""
    return tuple(dict.fromkeys(slot.topic for slot in canonical_order(plan)))


@dataclass(frozen=True)
class RootCause:
    """A message that could have been sent but was not, and the way from it to an estimate that waits for it.

    ``chain`` begins with the missing message itself; it ends with an estimate, unless nobody waits for it.
    """

    step: int
    chain: tuple[Slot, ...]

    @property
    def owner(self) -> str:
        """The node that owes the message, or `CHANNEL`."""
        return owner(self.chain[0].topic)

    def __str__(self) -> str:
        """Tell the chain as people do: ``e3 waits for slot 412 of s7->e3``, the estimator first."""
        nodes = [slot for slot in self.chain if owner(slot.topic) != CHANNEL]
        hops = [hop for hop in pairwise(nodes) if owner(hop[0].topic) != owner(hop[1].topic)]
        waits = [_wait(sent, waiting, self.step) for sent, waiting in hops]
        if self.owner == CHANNEL or not waits:
            waits.insert(0, _owes(self.chain[0], self.step))
        return "; ".join(reversed(waits))


def _round(slot: Slot) -> str:
    return f" (round {slot.round})" if slot.round else ""


def _wait(sent: Slot, waiting: Slot, step: int) -> str:
    source, receiver = owner(sent.topic), owner(waiting.topic)
    return f"{receiver} waits for slot {step} of {source}->{receiver}{_round(sent)}"


def _owes(slot: Slot, step: int) -> str:
    return f"{owner(slot.topic)} owes {slot.topic} of step {step}{_round(slot)}"


def _way_to_estimate(
    root: Slot, readers: Mapping[Slot, Sequence[Slot]], estimates: Collection[Slot]
) -> tuple[Slot, ...]:
    """Return the shortest chain of readers from a message to an estimate, or the message alone."""
    chains: list[tuple[Slot, ...]] = [(root,)]
    seen = {root}
    for chain in chains:
        if chain[-1] in estimates:
            return chain
        fresh = [slot for slot in readers.get(chain[-1], ()) if slot not in seen]
        seen.update(fresh)
        chains += [(*chain, slot) for slot in fresh]
    return (root,)


def wait_chain(plan: Plan, step: int, missing: Collection[tuple[str, int]]) -> tuple[RootCause, ...]:
    """Return why a step is not whole: the missing messages whose inputs are all there, in canonical order.

    ``step`` is the lowest incomplete step, so that nothing can be waiting for a step before it; it lacks the
    (topic, round) of ``missing``.
    """
    needs = dependencies(plan)
    readers: dict[Slot, list[Slot]] = {}
    for slot, inputs in needs.items():
        for source in inputs:
            readers.setdefault(source, []).append(slot)
    estimates = {Slot(keys.estimate(estimator.name), 0) for estimator in plan.estimators}
    lacking = set(missing)
    roots = [slot for slot, inputs in needs.items() if slot in lacking and lacking.isdisjoint(inputs)]
    return tuple(RootCause(step, _way_to_estimate(root, readers, estimates)) for root in roots)
