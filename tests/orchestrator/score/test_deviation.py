"""The deviation from a reference: against plain numpy on the published estimates, and where there is none."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from bus.messages import Estimate, Message
from orchestrator.backends.inprocess import run_messages
from orchestrator.score.gather import ScoreError
from orchestrator.score.results import Score, ScoreOptions
from orchestrator.score.scoring import score
from orchestrator.topology.load import Topology, TopologyError, load_topology

TEXT = """\
period_s: 1.0
steps: 30
plant: {model: quadruple_tank}
sensors:
  s1: {model: linear, C: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], noise: {std: 0.03}}
estimators:
  clean: {method: particle, sensors: [s1], particles: 20, stream: common}
  same: {method: particle, sensors: [s1], particles: 20, stream: common}
  other: {method: particle, sensors: [s1], particles: 20}
  attacked: {method: particle, sensors: [s1], particles: 20, stream: common}
attacks:
  - {bias: {value: 0.1}, on: s1->attacked, steps: [10, 29]}
score: {reference: clean, from_step: 5}
"""


@pytest.fixture
def topology(tmp_path: Path) -> Topology:
    path = tmp_path / "topology.yaml"
    path.write_text(TEXT)
    return load_topology(path)


def played(topology: Topology) -> list[tuple[str, Message]]:
    messages: list[tuple[str, Message]] = []
    run_messages(topology.plan, lambda topic, message: messages.append((topic, message)))
    return messages


def scored(topology: Topology, messages: list[tuple[str, Message]], options: ScoreOptions) -> Score:
    return score(topology.plan, messages, state_groups=topology.state_groups, options=options)


def test_it_is_the_difference_of_the_estimates_in_both_forms(topology: Topology) -> None:
    messages = played(topology)
    states = {
        name: np.array(
            [
                message.state
                for topic, message in messages
                if topic == f"estimate/{name}" and isinstance(message, Estimate)
            ]
        )
        for name in ("clean", "same", "other", "attacked")
    }
    found = {node.name: node.deviation for node in scored(topology, messages, topology.score_options).nodes}
    assert found["clean"] is None
    for name in ("same", "other", "attacked"):
        difference = states[name][5:] - states["clean"][5:]
        deviation = found[name]
        assert deviation is not None
        assert deviation.component_rms == pytest.approx(np.sqrt(np.mean(difference**2)), abs=1e-12)
        assert deviation.norm_over_steps == pytest.approx(np.sqrt(np.sum(difference**2)) / 25, abs=1e-12)


def test_filters_of_one_stream_draw_alike_and_differ_by_the_attack_alone(topology: Topology) -> None:
    messages = played(topology)
    found = {node.name: node.deviation for node in scored(topology, messages, topology.score_options).nodes}
    same, other, attacked = (found[name] for name in ("same", "other", "attacked"))
    assert same is not None
    assert other is not None
    assert attacked is not None
    assert same.component_rms == 0.0
    assert 0.0 < other.component_rms < attacked.component_rms


def test_without_a_reference_there_is_none_and_a_strange_one_is_refused(topology: Topology) -> None:
    messages = played(topology)
    none = scored(topology, messages, ScoreOptions())
    assert [node.deviation for node in none.nodes] == [None] * 4
    with pytest.raises(ScoreError, match="the reference 'nobody' is no estimator of the run"):
        scored(topology, messages, dataclasses.replace(topology.score_options, reference="nobody"))


def test_the_file_tells_a_reference_that_is_not_there(tmp_path: Path) -> None:
    path = tmp_path / "topology.yaml"
    path.write_text(TEXT.replace("reference: clean", "reference: cleen"))
    with pytest.raises(TopologyError, match=r"score\.reference: there is no estimator 'cleen'"):
        load_topology(path)


def test_the_resolved_topology_keeps_the_stream(topology: Topology, tmp_path: Path) -> None:
    path = tmp_path / "resolved.yaml"
    path.write_text(topology.resolved_yaml())
    assert [own.stream for own in load_topology(path).plan.estimators] == ["common", "common", "", "common"]
