"""The resolved topology says everything and gives the same plan; the log's copy is enough for the score."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bus.keys import EXCHANGE
from orchestrator.topology.experiment import topology_from_experiment
from orchestrator.topology.load import Topology, load_topology

TEXT = """\
description: some prose
period_s: 0.1
steps: 20
plant: {model: constant_acceleration, process_noise: {std: 0.2}, initial: {std: 1.0}}
sensors:
  s1..s3: {model: linear, C: [[1.0, 0.0, 0.0]], noise: {std: 0.1}}
  s4..s5: {model: linear, C: [[0, 1, 0]], noise: {covariance: [[0.3]]}}
estimators:
  e1..e4: {method: secure_distributed, coupling: 0.01, sensors: [s5, s1..s2]}
  k1..k4: {method: kalman}
  centre: {method: kalman_centralized}
graph: {random_geometric: {nodes: 4, radius: 0.3, seed: 2}}
channel:
  "*->*": perfect
  e*->e*: [{gilbert_elliott: {failure: 0.1, recovery: 0.9, scope: shared}}, {bernoulli: {loss: 0.1}}]
  s1->e*: {bernoulli: {loss: 0.5, stream: "{source}"}}
  s2->e1: []
attacks:
  - {bias: {value: 1}, on: s1->e1, steps: [[3, 5], [8, 9]]}
  - {bias: {value: [2]}, on: [s1->e1, s2->e*], name: second}
  - {bernoulli: {loss: 1}, on: s5->centre, steps: [0, 0]}
expect:
  rmse.position: [{node: e1..e2, at_most: 2}, {node: centre, at_least: 0}]
  packets.lost: {link: s5->centre, equals: 1}
  divergences: 0
score: {from_step: 5}
process: {window: 4, backend: inprocess}
"""

SENSORLESS = """\
period_s: 0.1
steps: 3
plant: {model: constant_acceleration, process_noise: {std: 0.2}, initial: {std: 1.0}}
estimators:
  e1..e3: {method: secure_distributed, coupling: 0.01, sensors: []}
graph: {ring: {nodes: 3}}
"""


@pytest.fixture
def topology(tmp_path: Path) -> Topology:
    path = tmp_path / "case.yaml"
    path.write_text(TEXT)
    return load_topology(path, seed=11, trial=3)


def again(topology: Topology, folder: Path) -> Topology:
    path = folder / "topology.yaml"
    path.write_text(topology.resolved_yaml())
    return load_topology(path)


def test_the_resolved_file_gives_the_same_run(topology: Topology, tmp_path: Path) -> None:
    resolved = again(topology, tmp_path)
    assert resolved.plan == topology.plan
    assert resolved.experiment_json() == topology.experiment_json()
    assert (resolved.settings, resolved.backend) == (topology.settings, topology.backend)


@pytest.mark.parametrize("sensors", ["", "sensors: {}\n", "sensors: null\n"])
def test_estimators_that_only_exchange_need_no_sensors(sensors: str, tmp_path: Path) -> None:
    path = tmp_path / "case.yaml"
    path.write_text(SENSORLESS + sensors)
    topology = load_topology(path)
    assert topology.plan.sensors == ()
    assert topology.warnings == ()
    assert {link.stream for link in topology.plan.links} == {EXCHANGE}
    resolved = again(topology, tmp_path)
    assert resolved.plan == topology.plan
    assert topology_from_experiment(topology.experiment_json()).plan.links == topology.plan.links


def test_resolving_twice_changes_nothing(topology: Topology, tmp_path: Path) -> None:
    resolved = again(topology, tmp_path)
    assert resolved.document == topology.document


_NUMBERS = st.floats(min_value=1e-6, max_value=1e6)


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    nodes=st.integers(2, 7),
    radius=st.floats(0.05, 1.0),
    std=_NUMBERS,
    loss=st.floats(0.0, 1.0),
    first=st.integers(0, 9),
    length=st.integers(0, 10),
    seed=st.integers(0, 2**53),
    shared=st.booleans(),
)
def test_resolving_is_idempotent_whatever_the_numbers(
    tmp_path: Path,
    nodes: int,
    radius: float,
    std: float,
    loss: float,
    first: int,
    length: int,
    seed: int,
    shared: bool,
) -> None:
    text: dict[str, Any] = {
        "seed": seed,
        "period_s": 0.1,
        "steps": 20,
        "plant": {"model": "constant_acceleration", "process_noise": {"std": std}, "initial": {"std": 1}},
        "sensors": {f"s1..s{nodes}": {"model": "linear", "C": [[1, 0, std]], "noise": {"std": std}}},
        "estimators": {f"e1..e{nodes}": {"method": "secure_distributed", "coupling": 0.01}},
        "graph": {"random_geometric": {"nodes": nodes, "radius": radius, "seed": seed}},
        "channel": {"e*->e*": {"bernoulli": {"loss": loss, "scope": "shared" if shared else "per_link"}}},
        "attacks": [{"bias": {"value": std}, "on": "s1->e1", "steps": [first, first + length]}],
    }
    path = tmp_path / "drawn.yaml"
    path.write_text(json.dumps(text))
    once = load_topology(path)
    twice = again(once, tmp_path)
    assert (twice.plan, twice.document) == (once.plan, once.document)


def test_the_log_tells_the_score_everything(topology: Topology) -> None:
    logged = topology_from_experiment(topology.experiment_json())
    plan, told = topology.plan, logged.plan
    assert (told.name, told.seed, told.trial, told.steps, told.period_s) == ("case", 11, 3, 20, 0.1)
    assert told.links == plan.links
    assert told.node_names == plan.node_names
    assert [(own.sensors, own.neighbours, own.rounds) for own in told.estimators] == [
        (own.sensors, own.neighbours, own.rounds) for own in plan.estimators
    ]
    assert [(s.label, s.streams, s.purpose, s.timing) for s in told.stages] == [
        (s.label, s.streams, s.purpose, s.timing) for s in plan.stages
    ]
    assert logged.state_groups == topology.state_groups
    assert logged.score_options == topology.score_options
    bare = [vars(expectation) | {"line": None} for expectation in topology.expectations]
    assert [vars(expectation) for expectation in logged.expectations] == bare


def test_the_experiment_holds_no_process_settings_prose_or_paths(topology: Topology, tmp_path: Path) -> None:
    other = tmp_path / "other.yaml"
    other.write_text(TEXT.replace("some prose", "other prose").replace("window: 4", "window: 9, stall_s: 3"))
    moved = load_topology(other, ["name=case"], seed=11, trial=3)
    assert moved.experiment_json() == topology.experiment_json()
    assert str(tmp_path).encode() not in topology.experiment_json()


def test_the_hash_tells_experiments_apart_and_spellings_not(topology: Topology, tmp_path: Path) -> None:
    path = tmp_path / "case.yaml"
    path.write_text(TEXT.replace("value: 1}", "value: 1.0}"))
    assert load_topology(path, seed=11, trial=3).hash == topology.hash
    assert load_topology(path, seed=12, trial=3).hash != topology.hash
    assert topology.at(seed=12).hash == load_topology(path, seed=12, trial=3).hash


def test_another_seed_or_trial_needs_no_second_reading(topology: Topology, tmp_path: Path) -> None:
    there = topology.at(seed=5, trial=6)
    assert (there.plan.seed, there.plan.trial) == (5, 6)
    assert again(there, tmp_path).plan == there.plan


PLUGIN = """\
from nodes.estimators.kalman import Kalman


class Mine(Kalman):
    def __init__(self, setting, *, gain: float = 2.0, shape: list[list[int]] | None = None) -> None:
        super().__init__(setting)
"""


def with_plugin(folder: Path, text: str = PLUGIN) -> Topology:
    folder.mkdir(exist_ok=True)
    (folder / "mine.py").write_text(text)
    path = folder / "case.yaml"
    path.write_text(TEXT.replace("k1..k4: {method: kalman}", "k1..k4: {method: ./mine.py:Mine, gain: 3}"))
    return load_topology(path)


def test_a_users_file_is_a_path_to_run_and_a_hash_to_log(tmp_path: Path) -> None:
    here, there = with_plugin(tmp_path / "here"), with_plugin(tmp_path / "there")
    assert here.plan.estimators[4].kind.reference == f"{tmp_path / 'here' / 'mine.py'}:Mine"
    assert here.plan.estimators[4].kind.parameters == {"gain": 3.0, "shape": None}
    assert here.hash == there.hash
    assert again(here, tmp_path).plan == here.plan
    changed = with_plugin(tmp_path / "changed", PLUGIN + "\n\nMORE = 1\n")
    assert changed.hash != here.hash


def test_a_log_is_read_without_the_users_file(tmp_path: Path) -> None:
    topology = with_plugin(tmp_path / "here")
    experiment = topology.experiment_json()
    (tmp_path / "here" / "mine.py").unlink()
    assert topology_from_experiment(experiment).plan.links == topology.plan.links
