"""One attacked run of a small network, as a topology, as a record in memory and as a run directory."""

from __future__ import annotations

import pytest

from bus.messages import Message
from orchestrator.backends.inprocess import run_messages
from orchestrator.run import RunReport, run_topology
from orchestrator.run_directory import make_run_directory
from orchestrator.topology.experiment import topology_from_experiment
from orchestrator.topology.load import load_topology
from orchestrator.topology.resolved import Topology
from tests.playing import LOSSY_RING

SMALL = (
    LOSSY_RING.format(name="small", seed=7, steps=24)
    + """\
attacks:
  - {bias: {value: 5.0}, on: s2->e2, steps: [10, 15]}
score: {from_step: 4, node_series: true, detection_grace: 2}
"""
)


@pytest.fixture(scope="session")
def small(tmp_path_factory: pytest.TempPathFactory) -> Topology:
    file = tmp_path_factory.mktemp("small") / "small.yaml"
    file.write_text(SMALL)
    return load_topology(file)


@pytest.fixture(scope="session")
def logged(small: Topology) -> Topology:
    """The topology as a log tells it."""
    return topology_from_experiment(small.experiment_json())


@pytest.fixture(scope="session")
def records(small: Topology) -> list[tuple[str, Message]]:
    held: list[tuple[str, Message]] = []
    run_messages(small.plan, lambda topic, message: held.append((topic, message)))
    return held


@pytest.fixture(scope="session")
def run(small: Topology, tmp_path_factory: pytest.TempPathFactory) -> RunReport:
    directory = make_run_directory(tmp_path_factory.mktemp("run") / "out", "small", 7)
    return run_topology(small, directory, "inprocess", lambda recorded: None)
