"""Row h: how many packets a channel process passes in a second, with five stages on every link and none."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.comparison import Comparison, at_least
from benchmarks.effort import Effort
from benchmarks.networks import load_text, network, ring
from bus import keys
from bus.intake import Intake
from bus.integrity import seal_of
from bus.messages import Message, encode
from bus.packets import Packet, transmission
from bus.plan import Plan
from bus.program import Scheduler
from channel.program import channel_programs

NODES = 20
_STEPS = 1000
_PAYLOADS = {keys.MEASUREMENT: 1, keys.EXCHANGE: 12}
_STAGES = """{"*->*": [
  %s,
  {gilbert_elliott: {failure: 0.01, recovery: 0.5}},
  {delay: {delay: 0.4, jitter: 0.3, distribution: normal, correlation: 0.5}},
  {duplicate: {probability: 0.005}},
  {corrupt: {probability: 0.005}}]}"""
_REORDER = "{reorder: {probability: 0.005}}"
_QUANTISE = "{quantise: {step: 0.001}}"


class _EncodingPort:
    """Encodes what the channel sends, as the bus does, and counts it."""

    def __init__(self) -> None:
        self.bytes = 0

    def send(self, topic: str, message: Message) -> None:
        """Encode a message."""
        self.bytes += len(encode(message))


def measure(rows: frozenset[str], effort: Effort) -> list[Comparison]:
    """Time both in turn, in this process, by its processor time."""
    steps = effort.steps(_STEPS)
    channels = {"perfect": "{}", "five": _STAGES % _REORDER, "rounded": _STAGES % _QUANTISE}
    with tempfile.TemporaryDirectory() as folder:
        plans = {
            name: load_text(Path(folder), network(NODES, steps, ring(NODES), channel=channel))
            for name, channel in channels.items()
        }
    samples: dict[str, list[float]] = {name: [] for name in plans}
    for repetition in range(effort.repeats):
        effort.tell(f"channel, {repetition + 1} of {effort.repeats}")
        for name, plan in plans.items():
            samples[name].append(packets_per_s(plan))
    what = "channel process's work, five stages a link"
    perfect = ("perfect links", samples["perfect"])
    return [
        Comparison("h", what, "packets/s", samples["five"], *perfect, at_least(0.7)),
        Comparison("h", f"{what}, every packet changed", "packets/s", samples["rounded"], *perfect),
    ]


def packets_per_s(plan: Plan) -> float:
    """Return how many packets a second the channel passes, one counted on every link and step.

    What is timed is what a channel process does in a run, but for the bus: it decodes what senders sent,
    passes it over their links, and builds and encodes inboxes and accounts.
    """
    scheduler, port = Scheduler(), _EncodingPort()
    for program, topics in channel_programs(port, plan):
        scheduler.add(program, topics)
    sent = list(_sent(plan))
    scheduler.run()
    intake = Intake({})
    began_s = time.process_time()
    for topic, payload in sent:
        scheduler.deliver(topic, intake.admit(topic, payload))
        scheduler.run()
    taken_s = time.process_time() - began_s
    if not scheduler.finished:
        raise RuntimeError("the channel waits for messages that nobody sends")
    return len(plan.links) * plan.steps / taken_s


def _sent(plan: Plan) -> Iterator[tuple[str, bytes]]:
    """Yield what all senders send, encoded: one packet a slot, of random values."""
    draws = np.random.default_rng(1)
    senders = [
        (stream, source, seal_of(plan, source))
        for stream in _PAYLOADS
        for source in dict.fromkeys(link.source for link in plan.links_of(stream))
    ]
    for step in range(plan.steps):
        for stream, source, seal in senders:
            packet = Packet(source, step, step, stream, draws.standard_normal(_PAYLOADS[stream]))
            check = () if seal is None else (seal(packet),)
            slot = transmission(step, step * plan.period_s, 0, step, packet.values.tolist(), *check)
            yield keys.tx(source, stream), encode(slot)
