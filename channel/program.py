"""The programs of the channel: one for each sender, all around the same network."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from bus import keys
from bus.messages import Transmission
from bus.packets import Delivery, Packet, Sending, packets_of_transmission
from bus.plan import Plan
from bus.program import Form, Port, Program, every_step, outlet
from channel.happened import Happened
from channel.network import PhaseNetwork, build_networks

STREAMS = (keys.MEASUREMENT, keys.EXCHANGE, keys.CONTROL)


class _Pacemaker(NamedTuple):
    """A sender that speaks to the end: what the channel says for a silent one goes at its pace."""

    topic: str
    rounds: int

    def wait(self) -> Program:
        """Wait until it has sent all slots of a step."""
        for _ in range(self.rounds):
            yield self.topic


def _pacemaker(plan: Plan) -> _Pacemaker:
    """Return a sender that is never silent; sensors are preferred, for the plant paces them."""
    rounds = {estimator.name: estimator.rounds for estimator in plan.estimators}
    for link in sorted(plan.links, key=lambda link: link.stream != keys.MEASUREMENT):
        if plan.silent_from(link.source) == plan.steps:
            return _Pacemaker(
                keys.tx(link.source, link.stream), rounds[link.source] if link.stream == keys.EXCHANGE else 1
            )
    raise ValueError("every sender falls silent: keep one that speaks to the end")


class _Events:
    """Sends the events of a phase in the order of steps and rounds, whichever is complete first.

    Where senders differ in their rounds, a late round of some may be complete before an early one of others.
    """

    def __init__(self, port: Port, stream: str, rounds: int) -> None:
        self._put = outlet(port, keys.channel(keys.phase_of(stream)))
        self._rounds = rounds
        self._next = 0
        self._held: dict[int, Happened] = {}

    def take(self, events: Happened) -> None:
        """Take the events of one step and round, and send what is due."""
        self._held[events.step * self._rounds + events.round] = events
        while self._next in self._held:
            self._put(self._held.pop(self._next))
            self._next += 1


def _sender_program(
    port: Port,
    plan: Plan,
    network: PhaseNetwork,
    source: str,
    stream: str,
    rounds: int,
    pacemaker: _Pacemaker | None,
    told_of: _Events,
) -> Program:
    topic = keys.tx(source, stream)
    phase = keys.phase_of(stream)
    outlets: dict[str, Callable[[Form], None]] = {}
    silent_from = plan.silent_from(source)
    is_told = bool(network.watched)

    def told(step: int) -> Program:
        """Let the triggers know of the step before."""
        for node in network.watched:
            if step <= plan.silent_from(node):
                watch: Transmission = yield keys.tx(node, keys.WATCH)
                network.note(node, step - 1, watch.values)

    def one_step(step: int) -> Program:
        t = step * plan.period_s
        if step and is_told:
            yield from told(step)
        if pacemaker is not None:
            yield from pacemaker.wait()
        for round_ in range(rounds):
            packets: Sequence[Packet] = ()
            if step < silent_from:
                slot: Transmission | Sending = yield topic
                packets = packets_of_transmission(slot, source, stream)
            for receiver, arrived, untouched in network.transmit(source, step, round_, packets):
                put = outlets.get(receiver)
                if put is None:
                    put = outlets[receiver] = outlet(port, keys.rx(receiver, phase))
                put(Delivery(step, t, round_, arrived, untouched))
            events = network.take_events(step, round_)
            if events is not None:
                told_of.take(events)

    return every_step("channel", plan.steps, one_step)


def channel_programs(port: Port, plan: Plan) -> list[tuple[Program, tuple[str, ...]]]:
    """Return the channel's programs, each with the topics that it receives."""
    rounds = {estimator.name: estimator.rounds for estimator in plan.estimators}
    programs: list[tuple[Program, tuple[str, ...]]] = []
    networks = build_networks(plan, STREAMS)
    for stream, network in networks.items():
        watches = tuple(keys.tx(node, keys.WATCH) for node in network.watched)
        events = _Events(port, stream, network.rounds)
        for source in network.sources:
            slots = rounds[source] if stream == keys.EXCHANGE else 1
            topics = (keys.tx(source, stream), *watches)
            pacemaker = None
            if plan.silent_from(source) < plan.steps:
                pacemaker = _pacemaker(plan)
                topics = (*topics, pacemaker.topic)
            program = _sender_program(port, plan, network, source, stream, slots, pacemaker, events)
            programs.append((program, topics))
    return programs
