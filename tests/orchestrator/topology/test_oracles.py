"""An oracle is a privilege: the topology grants it, and everything that would make no sense is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from orchestrator.topology.experiment import topology_from_experiment
from orchestrator.topology.load import TopologyError, load_topology

TEXT = """\
period_s: 1.0
steps: 20
plant: {model: quadruple_tank}
sensors:
  s1: {model: linear, C: [[1, 0, 0, 0]], noise: {std: 0.03}}
  s2: {model: linear, C: [[0, 1, 0, 0]], noise: {std: 0.03}}
estimators:
  e1..e2: {method: particle_fdi, sensors: all, minimum_attack: 0.28, particles: 50, attack_estimate: oracle}
  k1: {method: extended_kalman, sensors: all}
attacks:
  - {converging_bias: {target: 0.5}, on: "s1->*", name: bias, steps: [[2, 5], [8, 12]]}
  - {drift: {rate: 0.1}, on: "s2->e2"}
  - {noise: {std: 0.1}, on: "s2->e1", name: hiss}
oracles: ORACLES
"""


def written(folder: Path, oracles: str) -> Path:
    path = folder / "topology.yaml"
    path.write_text(TEXT.replace("ORACLES", oracles))
    return path


def problems(folder: Path, oracles: str) -> list[str]:
    with pytest.raises(TopologyError) as caught:
        load_topology(written(folder, oracles))
    return [f"{problem.path}: {problem.message} | {problem.cure}" for problem in caught.value.problems]


def test_each_estimator_is_told_of_the_attacks_named_for_it_in_all_their_windows(tmp_path: Path) -> None:
    topology = load_topology(written(tmp_path, "{e*: bias, e2: ['drift*']}"))
    oracles = {own.name: own.oracles for own in topology.plan.estimators}
    assert oracles == {"e1": ("bias", "bias/2"), "e2": ("bias", "bias/2", "drift@s2->e2"), "k1": ()}


def test_the_resolved_topology_and_the_log_grant_the_same(tmp_path: Path) -> None:
    topology = load_topology(written(tmp_path, "{e*: bias, e2: ['drift*']}"))
    again = tmp_path / "resolved.yaml"
    again.write_text(topology.resolved_yaml())
    assert load_topology(again).plan.estimators == topology.plan.estimators
    logged = topology_from_experiment(topology.experiment_json())
    assert [own.oracles for own in logged.plan.estimators] == [
        own.oracles for own in topology.plan.estimators
    ]
    assert load_topology(again).hash == topology.hash


def test_without_the_grant_the_method_is_refused_with_the_cure(tmp_path: Path) -> None:
    found = problems(tmp_path, "{e1: bias}")
    assert len(found) == 1
    assert "attack_estimate 'oracle' is a privilege that the topology does not grant" in found[0]
    assert "name the attacks in 'oracles: {e2: [...]}'" in found[0]


@pytest.mark.parametrize(
    ("oracles", "expected"),
    [
        ("{e*: bias, e7: bias}", "oracles.e7: there is no estimator 'e7'"),
        (
            "{e*: bias, k1: bias}",
            "oracles.k1: k1 makes no use of an oracle | take it out, or use a method that listens",
        ),
        (
            "{e*: [bias, brass]}",
            "oracles.e*[1]: no attack 'brass' is on the measurements of e1 | there are: bias, hiss",
        ),
        ("{e*: bias, e1: hiss}", "oracles.e1[0]: noise cannot tell what it adds"),
    ],
)
def test_a_grant_that_makes_no_sense_is_refused(tmp_path: Path, oracles: str, expected: str) -> None:
    assert any(expected in problem for problem in problems(tmp_path, oracles)), problems(tmp_path, oracles)
