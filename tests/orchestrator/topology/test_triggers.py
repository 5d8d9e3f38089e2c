"""Event triggers in topology files: how they are stated, inherited, resolved and refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from orchestrator.topology.experiment import topology_from_experiment
from orchestrator.topology.load import TopologyError, find_problems, load_topology

TEXT = """
name: triggered
period_s: 0.1
steps: 20
plant: {model: linear, A: [[0.9]], process_noise: {std: 0.1}, initial: {std: 1.0}}
sensors:
  s1..s2: {model: linear, C: [[1.0]], noise: {std: 0.3}, send: {send_on_delta: {threshold: 0.1}}}
  s3: {model: linear, C: [[1.0]], noise: {std: 0.3}}
estimators:
  e1..e3: {method: secure_distributed, coupling: 0.01, send: {periodic: {every: 3}}}
graph: {ring: {nodes: 3}}
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "triggered.yaml"
    path.write_text(TEXT)
    return path


def test_a_trigger_stands_in_the_plan_of_its_sender(file: Path) -> None:
    plan = load_topology(file).plan
    assert plan.triggered == ("s1", "s2", "e1", "e2", "e3")
    assert plan.sensors[0].send is not None
    assert plan.sensors[0].send.reference == "nodes.triggers.send_on_delta:SendOnDelta"
    assert plan.sensors[0].send.parameters["threshold"] == 0.1


def test_a_resolved_topology_gives_the_same_experiment_again(file: Path, tmp_path: Path) -> None:
    topology = load_topology(file)
    again = tmp_path / "again.yaml"
    again.write_text(topology.resolved_yaml())
    assert load_topology(again).experiment_json() == topology.experiment_json()
    logged = topology_from_experiment(topology.experiment_json())
    assert logged.plan.triggered == topology.plan.triggered


def test_an_heir_takes_a_trigger_away_or_another_in_its_place(file: Path, tmp_path: Path) -> None:
    heir = tmp_path / "heir.yaml"
    heir.write_text(
        "extends: triggered.yaml\n"
        "sensors:\n"
        "  s1: {send: {periodic: {every: 2}}}\n"
        "  s2: {send: null}\n"
        "estimators:\n"
        "  e1: {send: {periodic: {phase: 1}}}\n"
        "  e2: {method: fixed_gain_consensus, gain: [0.5], coupling: 0.01}\n"
    )
    plan = load_topology(heir, ["graph={edges: [[e1, e2], [e1, e3]]}"]).plan
    assert plan.triggered == ("s1", "e1", "e2", "e3")
    assert plan.sensors[0].send is not None
    assert plan.sensors[0].send.reference.endswith(":Periodic")
    own = {estimator.name: estimator.send for estimator in plan.estimators}
    assert own["e1"] is not None
    assert own["e1"].parameters == {"every": 3, "phase": 1}


@pytest.mark.parametrize(
    ("override", "words"),
    [
        (
            "sensors.s1.send={send_on_delta: {threshold: 0.1}, periodic: {every: 2}}",
            "exactly one event trigger",
        ),
        ("sensors.s1.send={send_on_dalta: {}}", "there is no trigger kind 'send_on_dalta'"),
        ("sensors.s1.send={send_on_delta: 3}", "not a mapping"),
        ("sensors.s1.send={send_on_delta: {threshold: -1}}", "must be more than 0"),
        ("sensors.s1.send={periodic: {every: 2, phase: 2}}", "not within the period"),
        (
            "estimators.e1.send={deterministic_innovation: {threshold: 1}}",
            "only a sensor's values are predicted",
        ),
        ("estimators.e1.method=kalman", "e1 sends to no neighbour"),
    ],
)
def test_what_cannot_be_is_refused_with_its_place(file: Path, override: str, words: str) -> None:
    with pytest.raises(TopologyError) as caught:
        load_topology(file, [override])
    assert any(words in f"{problem}" for problem in caught.value.problems)


def test_an_external_programs_sending_is_its_own(file: Path) -> None:
    overrides = [
        "estimators.e1.method=external",
        "estimators.e1.command=[x]",
        "estimators.e1.rounds=1",
        "estimators.e1.send={periodic: {every: 2}}",
    ]
    errors, _ = find_problems(file, overrides)
    assert any("decides itself" in str(problem) for problem in errors)


def test_the_rate_may_be_expected_of_senders_and_of_nobody_else(file: Path) -> None:
    expectations = load_topology(file, ["expect={sent_rate: [{node: s1..s2, at_most: 1}, {at_most: 1}]}"])
    assert expectations.expectations[0].nodes == ("s1", "s2")
    for limit in ("{node: s9, at_most: 1}", "{link: s1->e1, at_most: 1}"):
        errors, _ = find_problems(file, [f"expect={{sent_rate: {limit}}}"])
        assert errors
