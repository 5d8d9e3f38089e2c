"""Topologies played in this process: what their nodes and channel said, and the score of it."""

from __future__ import annotations

from bus.messages import Message
from orchestrator.backends.inprocess import run_messages
from orchestrator.score.gather import gather
from orchestrator.score.results import Score
from orchestrator.topology.resolved import Topology
from orchestrator.topology_score import score_topology

Record = list[tuple[str, Message]]

RING = """
name: {name}
seed: {seed}
period_s: 0.1
steps: {steps}
plant: {{model: constant_acceleration, process_noise: {{std: 0.2}}, initial: {{std: 1.0}}}}
graph: {{ring: {{nodes: 3}}}}
sensors:
  s1..s3: {{model: linear, C: [[1.0, 0.0, 0.0]], noise: {{std: 0.1}}}}
estimators:
  e1..e3: {{method: secure_distributed, coupling: 0.01}}
"""
"""The head of a small topology, to be formatted: three estimators on a ring. Tests add to it."""

LOSSY_RING = (
    RING
    + """\
  lone: {{method: kalman, sensors: [s1, s3]}}
channel:
  e*->e*: {{gilbert_elliott: {{failure: 0.2, recovery: 0.5}}}}
  s*->lone: {{bernoulli: {{loss: 0.3}}}}
"""
)
"""The same with an estimator beside the ring, and losses on the way."""


def record_of(topology: Topology) -> Record:
    """Run a topology and return all its messages."""
    record: Record = []
    run_messages(topology.plan, lambda topic, message: record.append((topic, message)))
    return record


def scored(topology: Topology, record: Record | None = None) -> Score:
    """Return the score of a record of the topology; without one it is played."""
    record = record_of(topology) if record is None else record
    return score_topology(topology, gather(topology.plan, record))[0]


def assert_keeps_what_it_expects(score: Score) -> None:
    """Assert that the run is complete and every expectation held."""
    assert score.passed, [outcome.message for outcome in score.expectations if not outcome.passed]
