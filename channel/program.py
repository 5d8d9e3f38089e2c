"""The programs of the channel: one for each sender, all around the same network."""

from __future__ import annotations

from bus import keys
from bus.messages import Transmission
from bus.packets import inbox, packets_of_transmission
from bus.plan import Plan
from bus.program import Port, Program, every_step
from channel.network import PhaseNetwork, build_network


def _sender_program(
    port: Port, plan: Plan, network: PhaseNetwork, source: str, stream: str, rounds: int
) -> Program:
    topic = keys.tx(source, stream)
    phase = keys.phase_of(stream)
    events_topic = keys.channel(phase)

    def one_step(step: int) -> Program:
        t = step * plan.period_s
        for round_ in range(rounds):
            slot: Transmission = yield topic
            packets = packets_of_transmission(slot, source, stream)
            for receiver, arrived in network.transmit(source, step, round_, packets):
                port.send(keys.rx(receiver, phase), inbox(step, t, round_, arrived))
            events = network.take_events(step, round_)
            if events is not None:
                port.send(events_topic, events)

    return every_step("channel", plan.steps, one_step)


def channel_programs(port: Port, plan: Plan) -> list[tuple[Program, tuple[str, ...]]]:
    """Return the channel's programs, each with the topics that it receives."""
    rounds = {estimator.name: estimator.rounds for estimator in plan.estimators}
    programs: list[tuple[Program, tuple[str, ...]]] = []
    for stream in (keys.MEASUREMENT, keys.EXCHANGE):
        network = build_network(plan, stream)
        for source in network.sources:
            slots = 1 if stream == keys.MEASUREMENT else rounds[source]
            program = _sender_program(port, plan, network, source, stream, slots)
            programs.append((program, (keys.tx(source, stream),)))
    return programs
