"""Errors against the truth, divergence, and disagreement, on records whose answers are known."""

from __future__ import annotations

import math

import pytest

from orchestrator.score.gather import ScoreError
from orchestrator.score.measure import node_value
from orchestrator.score.results import ScoreOptions
from orchestrator.score.scoring import score

GROUPS = {"position": [0], "velocity": [1]}


def test_rmse_is_the_root_of_the_mean_squared_euclidean_error(make_plan, recorder):
    for step, error in enumerate([(3.0, 4.0), (0.0, 0.0), (1.0, -2.0)]):
        recorder.truth(step, [10.0, 20.0])
        recorder.estimate("e1", step, [10.0 + error[0], 20.0 + error[1]])
    groups = score(make_plan(3, {"e1": ["s1"]}), recorder.records, state_groups=GROUPS).nodes[0].groups
    assert groups["position"].rmse == pytest.approx(math.sqrt(10 / 3))
    assert groups["velocity"].rmse == pytest.approx(math.sqrt(20 / 3))
    assert groups["state"].rmse == pytest.approx(math.sqrt(30 / 3))
    assert groups["state"].peak == pytest.approx(5.0)


def test_a_prediction_is_compared_with_the_step_it_refers_to(make_plan, recorder):
    for step in range(4):
        recorder.truth(step, [float(step)])
        recorder.estimate("e1", step, [float(step + 1)], refers_to=step + 1)
    result = score(make_plan(4, {"e1": ["s1"]}), recorder.records, state_groups={})
    assert result.nodes[0].groups["state"].rmse == 0.0
    assert result.complete
    assert result.nodes[0].divergence_step is None


def test_errors_count_from_from_step_on(make_plan, recorder):
    for step in range(4):
        recorder.truth(step, [0.0])
        recorder.estimate("e1", step, [100.0 if step < 2 else 1.0])
    plan = make_plan(4, {"e1": ["s1"]})
    settled = score(plan, recorder.records, state_groups={}, options=ScoreOptions(from_step=2))
    assert settled.nodes[0].groups["state"].rmse == 1.0
    assert settled.nodes[0].groups["state"].peak == 1.0
    assert settled.networks[0].rmse["state"] == [100.0, 100.0, 1.0, 1.0]


def test_the_final_error_is_that_of_the_last_estimate_about_a_step_of_the_run(make_plan, recorder):
    for step, (filtered, predicted) in enumerate([(1.0, 4.0), (2.0, 5.0), (3.0, 6.0)]):
        recorder.truth(step, [0.0])
        recorder.estimate("e1", step, [filtered])
        recorder.estimate("e2", step, [predicted], refers_to=step + 1)
        recorder.estimate("e3", step, [] if step else [9.0], diverged=step > 0)
    plan = make_plan(3, {"e1": ["s1"], "e2": ["s1"], "e3": ["s1"]})
    result = score(plan, recorder.records, state_groups={})
    assert [node.groups["state"].final for node in result.nodes] == [3.0, 5.0, None]
    assert [node_value(result, node, "final.state") for node in result.nodes] == [3.0, 5.0, math.inf]
    late = score(plan, recorder.records, state_groups={}, options=ScoreOptions(from_step=2))
    assert [node.groups["state"].final for node in late.nodes] == [3.0, None, None]


def test_errors_are_split_by_the_steps_in_which_an_attacked_packet_arrived(make_plan, recorder):
    for step in range(4):
        attacked = step == 2
        recorder.truth(step, [0.0])
        recorder.inbox("e1", step, [("s1", step)])
        recorder.channel(step, events=[("s1->e1", "bias", step, "attacked")] if attacked else [])
        recorder.estimate("e1", step, [5.0 if attacked else 1.0])
    node = score(make_plan(4, {"e1": ["s1"]}), recorder.records, state_groups={}).nodes[0]
    assert (node.groups["state"].attacked, node.groups["state"].unattacked) == (5.0, 1.0)
    assert node.attacked_steps == 1


def test_an_estimator_that_says_it_diverged_has_no_rmse(make_plan, recorder):
    for step in range(3):
        recorder.truth(step, [0.0])
        recorder.estimate("e1", step, [] if step == 2 else [1.0], diverged=step == 2)
    node = score(make_plan(3, {"e1": ["s1"]}), recorder.records, state_groups={}).nodes[0]
    assert node.divergence_step == 2
    assert node.groups["state"].rmse is None
    assert node.complete


def test_an_error_above_the_bound_is_a_divergence(make_plan, recorder):
    for step, state in enumerate([0.0, 1e7, 0.0]):
        recorder.truth(step, [0.0])
        recorder.estimate("e1", step, [state])
    plan = make_plan(3, {"e1": ["s1"]})
    assert score(plan, recorder.records, state_groups={}).nodes[0].divergence_step == 1
    lenient = ScoreOptions(divergence_bound=1e8)
    assert score(plan, recorder.records, state_groups={}, options=lenient).nodes[0].divergence_step is None


def test_a_missing_estimate_makes_the_score_incomplete(make_plan, recorder):
    for step in range(3):
        recorder.truth(step, [0.0])
        if step != 1:
            recorder.estimate("e1", step, [2.0])
    result = score(make_plan(3, {"e1": ["s1"]}), recorder.records, state_groups={})
    assert not result.complete
    assert not result.passed
    assert result.nodes[0].steps_scored == 2
    assert result.nodes[0].groups["state"].rmse == 2.0


def test_an_empty_record_is_scored_as_incomplete(make_plan):
    result = score(make_plan(3, {"e1": ["s1"]}), [], state_groups=GROUPS)
    assert not result.complete
    assert result.nodes[0].groups["position"].rmse is None
    assert result.nodes[0].nees.mean is None


def test_disagreement_is_the_rms_distance_from_the_mean_estimate(make_plan, recorder):
    recorder.truth(0, [0.0, 0.0])
    for name, state in {"e1": [1.0, 0.0], "e2": [-1.0, 0.0], "e3": [0.0, 3.0]}.items():
        recorder.estimate(name, 0, state)
    plan = make_plan(1, {name: ["s1"] for name in ("e1", "e2", "e3")}, {"e1": ["e2"], "e2": ["e3"]})
    (network,) = score(plan, recorder.records, state_groups={}).networks
    assert network.members == ["e1", "e2", "e3"]
    assert network.disagreement == pytest.approx(math.sqrt((2.0 + 2.0 + 4.0) / 3))


def test_networks_that_do_not_exchange_are_not_compared(make_plan, recorder):
    recorder.truth(0, [0.0])
    for name, state in {"e1": 1.0, "e2": 1.0, "f1": 9.0, "f2": 9.0}.items():
        recorder.estimate(name, 0, [state])
    plan = make_plan(1, {name: ["s1"] for name in ("e1", "f1", "e2", "f2")}, {"e1": ["e2"], "f2": ["f1"]})
    networks = score(plan, recorder.records, state_groups={}).networks
    assert [network.members for network in networks] == [["e1", "e2"], ["f1", "f2"]]
    assert [network.disagreement for network in networks] == [0.0, 0.0]


def test_isolated_estimators_of_one_kind_are_compared(make_plan, recorder):
    recorder.truth(0, [0.0])
    recorder.estimate("e1", 0, [1.0])
    recorder.estimate("e2", 0, [3.0])
    plan = make_plan(1, {"e1": ["s1"], "e2": ["s1"]})
    (network,) = score(plan, recorder.records, state_groups={}).networks
    assert network.disagreement == 1.0


def test_a_diverged_member_leaves_the_others_curve_but_not_the_average(make_plan, recorder):
    for step in range(2):
        recorder.truth(step, [0.0])
        recorder.estimate("e1", step, [1.0])
        recorder.estimate("e2", step, [3.0] if step == 0 else [], diverged=step == 1)
    plan = make_plan(2, {"e1": ["s1"], "e2": ["s1"]}, {"e1": ["e2"]})
    (network,) = score(plan, recorder.records, state_groups={}).networks
    assert network.rmse["state"] == [pytest.approx(math.sqrt(5.0)), 1.0]
    assert network.disagreement_by_step == [1.0, None]
    assert network.disagreement is None


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        (("e9", 0, [0.0]), "unknown estimator at step 0 stands outside the plan"),
        (("e1", 5, [0.0]), "e1 at step 5 stands outside the plan"),
        (("e1", 0, [0.0, 1.0]), "e1 at step 0 has a state of another size than the plant's 1"),
        (("e1", 1, [0.0]), "e1 at step 1 stands in the record twice"),
    ],
)
def test_a_record_that_does_not_fit_its_plan_is_refused(make_plan, recorder, fault, message):
    recorder.truth(0, [0.0])
    recorder.truth(1, [0.0])
    recorder.estimate("e1", 1, [0.0])
    recorder.estimate(*fault)
    with pytest.raises(ScoreError, match=message):
        score(make_plan(2, {"e1": ["s1"]}), recorder.records, state_groups={})


def test_a_state_group_outside_the_state_is_refused(make_plan, recorder):
    recorder.truth(0, [0.0])
    with pytest.raises(ScoreError, match="'speed' names component 3"):
        score(make_plan(1, {"e1": ["s1"]}), recorder.records, state_groups={"speed": [3]})
