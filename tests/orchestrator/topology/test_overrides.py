"""``--set path=value`` reaches everything a topology holds, and nothing that it does not."""

from __future__ import annotations

from pathlib import Path

import pytest

from orchestrator.topology.load import Topology, TopologyError, load_topology
from tests.orchestrator.topology.small import GOOD

TEXT = (
    GOOD.replace("{bernoulli: {loss: 0.1}}", "[{bernoulli: {loss: 0.1}}]")
    + """\
attacks:
  - {bias: {value: 1}, on: s1->e1, steps: [3, 5]}
expect:
  rmse.position: {node: e1, at_most: 2}
"""
)


def load(folder: Path, *overrides: str) -> Topology:
    path = folder / "topology.yaml"
    path.write_text(TEXT)
    return load_topology(path, overrides)


def test_a_number_of_the_run(tmp_path: Path) -> None:
    assert load(tmp_path, "steps=7", "attacks=[]").plan.steps == 7


def test_a_key_that_the_file_does_not_state(tmp_path: Path) -> None:
    assert load(tmp_path, "process.window=3").settings.window == 3


def test_one_node_out_of_a_range(tmp_path: Path) -> None:
    plan = load(tmp_path, "sensors.s3.noise.std=0.7").plan
    assert [sensor.kind.parameters["noise"].std for sensor in plan.sensors] == [0.1, 0.1, 0.7, 0.1]


def test_a_section_may_be_stated_with_groups(tmp_path: Path) -> None:
    stated = "estimators={e1..e4: {method: secure_distributed, coupling: 0.02}}"
    plan = load(tmp_path, stated, "estimators.e2.coupling=0.03").plan
    assert [own.kind.parameters["coupling"] for own in plan.estimators] == [0.02, 0.03, 0.02, 0.02]


@pytest.mark.parametrize("nodes", ["e2..e3", "e[2]"])
def test_a_range_of_nodes(nodes: str, tmp_path: Path) -> None:
    if nodes == "e[2]":
        with pytest.raises(TopologyError, match="there is no node 'e'"):
            load(tmp_path, f"estimators.{nodes}.threshold=4")
        return
    plan = load(tmp_path, f"estimators.{nodes}.threshold=4").plan
    assert [own.kind.parameters["threshold"] for own in plan.estimators] == [9.0, 4.0, 4.0, 9.0]


def test_a_pattern_of_nodes(tmp_path: Path) -> None:
    plan = load(tmp_path, "estimators.e*.threshold=4").plan
    assert {own.kind.parameters["threshold"] for own in plan.estimators} == {4.0}


def test_another_method_for_one_node_leaves_its_old_parameters_behind(tmp_path: Path) -> None:
    plan = load(tmp_path, "estimators.e4.method=kalman").plan
    other = plan.estimators[3]
    assert other.kind.reference == "nodes.estimators.kalman:Kalman"
    assert dict(other.kind.parameters) == {"threshold": None, "on_alarm": "flag"}
    assert (other.rounds, other.sensors, dict(other.neighbours)) == (0, ("s4",), {})
    assert dict(plan.estimators[0].neighbours) == {"e2": 1.0}


def test_the_same_method_again_keeps_the_parameters(tmp_path: Path) -> None:
    plan = load(tmp_path, "estimators.e4.method=secure_distributed").plan
    assert plan.estimators[3].kind.parameters["threshold"] == 9.0


@pytest.mark.parametrize("path", ["attacks[0].steps", "attacks.0.steps"])
def test_an_item_of_a_list(path: str, tmp_path: Path) -> None:
    stage = load(tmp_path, f"{path}=[7, 9]").plan.stages[0]
    assert (stage.timing.first, stage.timing.last) == (7, 9)


def test_a_metric_whose_name_holds_a_dot(tmp_path: Path) -> None:
    topology = load(tmp_path, "expect.rmse.position.at_most=5", "expect.rmse.velocity.at_most=6")
    bounds = {expectation.metric: expectation.at_most for expectation in topology.expectations}
    assert bounds == {"rmse.position": 5.0, "rmse.velocity": 6.0}


def test_a_link_pattern(tmp_path: Path) -> None:
    topology = load(tmp_path, "channel.e*->e*[0].bernoulli.loss=0.5", "channel.e1->e2=perfect")
    losses = [stage.kind.parameters.get("loss") for stage in topology.plan.stages[1:]]
    assert losses == [0.5, None]


def test_null_takes_a_parameter_or_a_node_away(tmp_path: Path) -> None:
    topology = load(
        tmp_path, "estimators.e4=null", "graph={ring: {nodes: 3}}", "estimators.e1.threshold=null"
    )
    assert [own.name for own in topology.plan.estimators] == ["e1", "e2", "e3"]
    assert topology.plan.estimators[0].kind.parameters["threshold"] == 25.0


def test_later_overrides_see_earlier_ones(tmp_path: Path) -> None:
    overrides = ("sensors.s1={model: linear, C: [[1, 0, 0]], noise: {std: 3}}", "sensors.s1.noise.std=4")
    assert load(tmp_path, *overrides).plan.sensors[0].kind.parameters["noise"].std == 4.0


def test_seed_and_trial_have_arguments_of_their_own(tmp_path: Path) -> None:
    load(tmp_path)
    plan = load_topology(tmp_path / "topology.yaml", seed=5, trial=6).plan
    assert (plan.seed, plan.trial) == (5, 6)


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("steps", "is not of the form path=value"),
        ("=3", "is not of the form path=value"),
        ("stepz=3", "did you mean 'steps'?"),
        ("estimator.e4.threshold=4", "did you mean 'estimators'?"),
        ("estimators.e9.threshold=4", "there is no node 'e9' among the estimators"),
        ("estimators.e4.treshold=4", "did you mean 'threshold'?"),
        ("sensors.s4..s1.model=linear", "there is no node 's4..s1'"),
        ("sensors.s$={}", "'s$' is not a name"),
        ("attacks[3].steps=[1, 2]", "the list has no item '3'"),
        ("attacks.first.steps=[1, 2]", "the list has no item 'first'"),
        ("steps.of.run=3", "leads into a value that has no members"),
        ("channel.e1.bernoulli=3", "there is no channel 'e1'"),
        ("steps=-3", "must be at least 1"),
        ("steps=[1", "not YAML"),
        ("period_s=.inf", "not a finite number"),
    ],
)
def test_an_override_that_fits_nothing_is_named(override: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(TopologyError) as caught:
        load(tmp_path, override)
    (problem,) = caught.value.problems
    assert problem.file == f"--set {override}"
    assert words in str(problem)


def test_three_dots_reach_every_such_key_below(tmp_path: Path) -> None:
    plan = load(tmp_path, "sensors...std=0.7", "channel...loss=0.25", "estimators.e1..e2...threshold=16").plan
    assert [sensor.kind.parameters["noise"].std for sensor in plan.sensors] == [0.7] * 4
    assert [own.kind.parameters["threshold"] for own in plan.estimators] == [16, 16, 9, 9]
    (loss,) = {stage.kind.parameters.get("loss") for stage in plan.stages} - {None}
    assert loss == 0.25


def test_three_dots_lead_into_lists_and_from_the_top(tmp_path: Path) -> None:
    plan = load(tmp_path, "...bias.value=4").plan
    assert [stage.kind.parameters["value"] for stage in plan.stages if "value" in stage.kind.parameters] == [
        4
    ]


@pytest.mark.parametrize("path", ["channel...recovery", "...nothing", "channel..."])
def test_three_dots_that_lead_nowhere_are_refused(path: str, tmp_path: Path) -> None:
    with pytest.raises(TopologyError, match=r"no '\w+' stands|does not say what it leads to"):
        load(tmp_path, f"{path}=1")


def test_the_method_of_all_estimators_has_a_short_path(tmp_path: Path) -> None:
    plan = load(tmp_path, "method=kalman", "graph=null", "channel=null").plan
    assert {own.kind.reference.rpartition(":")[2] for own in plan.estimators} == {"Kalman"}
