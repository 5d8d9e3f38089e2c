"""Row h: how many packets the channel passes in a second, with five stages on every link and with none."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.comparison import Comparison
from benchmarks.effort import Effort
from benchmarks.networks import load_text, network, ring
from bus import keys
from bus.packets import Packet
from bus.plan import Plan
from channel.network import build_network

NODES = 20
_STEPS = 400
_STAGES = """{e*->e*: [
  {gilbert_elliott: {failure: 0.01, recovery: 0.9}},
  {bernoulli: {loss: 0.01}},
  {gilbert_elliott: {failure: 0.01, recovery: 0.9, scope: shared}},
  {bernoulli: {loss: 0.01, scope: shared}}]}"""
_ATTACKS = "[{bias: {value: 0.1}, on: e*->e*}]"


def measure(rows: frozenset[str], effort: Effort) -> list[Comparison]:
    """Time both in turn, in this process, by its processor time."""
    steps = effort.steps(_STEPS)
    with tempfile.TemporaryDirectory() as folder:
        perfect = load_text(Path(folder), network(NODES, steps, ring(NODES)))
        staged = load_text(
            Path(folder), network(NODES, steps, ring(NODES), channel=_STAGES, attacks=_ATTACKS)
        )
    with_stages, without = [], []
    for repetition in range(effort.repeats):
        effort.tell(f"channel, {repetition + 1} of {effort.repeats}")
        with_stages.append(_packets_per_s(staged))
        without.append(_packets_per_s(perfect))
    what = "channel in one process, five stages a link"
    return [Comparison("h", what, "packets/s", with_stages, "perfect links", without)]


def _packets_per_s(plan: Plan) -> float:
    """Return how many packets a second pass the links between neighbours; one counts on every link."""
    network = build_network(plan, keys.EXCHANGE)
    values = np.arange(12.0)
    began_s = time.process_time()
    for step in range(plan.steps):
        for source in network.sources:
            network.transmit(source, step, 0, [Packet(source, step, step, keys.EXCHANGE, values)])
        network.take_events(step, 0)
    return len(plan.links_of(keys.EXCHANGE)) * plan.steps / (time.process_time() - began_s)
