"""Expectations held against a score, and the catalogue of what may be expected."""

from __future__ import annotations

import math

import pytest

from orchestrator.score.catalogue import METRICS, find_metric, metric_names
from orchestrator.score.expectation import Expectation
from orchestrator.score.gather import ScoreError
from orchestrator.score.measure import measure
from orchestrator.score.scoring import score

GROUPS = {"position": [0]}


@pytest.fixture(scope="module")
def run(make_network):
    return make_network(
        steps=60,
        nodes=6,
        attacked={"e2": (10, 15), "e4": (20, 25)},
        recall=1.0,
        deaf=["e2"],
        diverging={"e5": 31},
    )


@pytest.fixture(scope="module")
def expect(run):
    def judged(metric, **expectation):
        expected = Expectation(metric, **expectation)
        result = score(run.plan(), run.records(), state_groups=GROUPS, expectations=[expected])
        (outcome,) = result.expectations
        assert outcome.passed == result.passed
        return outcome

    return judged


def test_every_metric_of_the_catalogue_can_be_measured(run):
    result = score(run.plan(), run.records(), state_groups=GROUPS)
    for name in metric_names(GROUPS):
        metric = find_metric(name, GROUPS)
        assert measure(result, name, metric)
        for selector in metric.selectors:
            named = {"nodes": ["e2"]} if selector == "node" else {"links": ["s2->e2"]}
            assert measure(result, name, metric, **named)


def test_counts_alone_are_defined_where_nothing_happened_and_the_catalogue_says_so(make_plan, recorder):
    recorder.truth(0, [0.0])
    empty = score(make_plan(3, {"e1": ["s1"]}), recorder.records, state_groups=GROUPS)
    for name in metric_names(GROUPS):
        metric = find_metric(name, GROUPS)
        figures = [value for _, value in measure(empty, name, metric)]
        is_count = metric.undefined == "nowhere: it is a count"
        assert is_count == (figures != [] and not any(map(math.isnan, figures))), name


def test_a_family_of_metrics_has_one_for_each_group_and_for_the_state():
    assert find_metric("rmse.position", GROUPS) is METRICS["rmse.*"]
    assert find_metric("rmse.state", GROUPS) is METRICS["rmse.*"]
    assert find_metric("rmse.colour", GROUPS) is None
    assert find_metric("rmse.*", GROUPS) is None
    assert find_metric("rmse", GROUPS) is None


def test_at_most_is_held_against_the_largest_and_at_least_against_the_smallest(run, expect):
    result = score(run.plan(), run.records(), state_groups=GROUPS)
    errors = {node.name: node.groups["position"].rmse for node in result.nodes if node.name in ("e1", "e3")}
    most = expect("rmse.position", nodes=("e1", "e3"), at_most=1.0)
    assert (most.measured, most.where) == (max(errors.values()), max(errors, key=errors.get))
    least = expect("rmse.position", nodes=("e1", "e3"), at_least=0.0)
    assert (least.measured, least.where) == (min(errors.values()), min(errors, key=errors.get))
    assert most.passed
    assert least.passed


def test_exactly_is_held_against_the_value_farthest_off(expect):
    outcome = expect("divergences", nodes=("e1", "e5"), equals=0)
    assert (outcome.measured, outcome.where, outcome.passed) == (1.0, "e5", False)


def test_counts_are_totals_unless_nodes_or_links_are_named(expect):
    assert expect("packets.sent", equals=60 * 18).passed
    assert expect("packets.sent", links=("s1->e1", "s2->e2"), equals=60).passed
    assert expect("packets.sent", nodes=("e1",), equals=180).passed
    assert expect("lockouts", equals=1).passed
    assert expect("lockouts", nodes=("e2",), equals=1).passed
    assert expect("lockouts", nodes=("e1",), equals=0).passed
    assert expect("divergences", equals=1).passed


def test_the_error_of_a_diverged_estimator_is_above_every_bound(expect):
    failed = expect("rmse.position", at_most=1e9)
    assert (failed.passed, failed.measured, failed.where) == (False, None, "e5")
    assert "without bound" in failed.message
    assert expect("rmse.position", nodes=("e5",), at_least=5.0).passed
    assert not expect("disagreement", at_most=1e9).passed


def test_an_undefined_figure_fails_and_says_why(expect):
    outcome = expect("detector.recall", links=("s1->e1",), at_least=0.0)
    assert not outcome.passed
    assert outcome.message == (
        "detector.recall at least 0: undefined for s1->e1, no attacked packet met a detector"
    )


def test_undefined_figures_do_not_matter_where_nothing_was_named(expect):
    assert expect("rmse_attacked.position", at_least=0.0).where in ("e2", "e4")


def test_a_missed_window_has_a_delay_above_every_bound(make_network):
    run = make_network(steps=30, nodes=3, attacked={"e2": (10, 15)}, recall=0.0, false_alarms=0.0)
    expectations = [
        Expectation("detector.delay", at_most=100),
        Expectation("detector.missed_windows", equals=1),
    ]
    result = score(run.plan(), run.records(), state_groups=GROUPS, expectations=expectations)
    assert [outcome.passed for outcome in result.expectations] == [False, True]


def test_a_message_shows_the_numbers(expect):
    assert expect("detector.delay", at_most=2).message == (
        "detector.delay at most 2: 0 (s2->e2 from step 10, worst of 2)"
    )


def test_each_bound_has_an_outcome_with_its_line(run):
    expected = Expectation("nis.ratio", nodes=("e1",), at_least=0.1, at_most=3.0, line=17)
    result = score(run.plan(), run.records(), state_groups=GROUPS, expectations=[expected])
    assert [(outcome.relation, outcome.line) for outcome in result.expectations] == [("<=", 17), (">=", 17)]
    assert result.passed


def test_an_unknown_metric_is_refused_with_those_that_exist(run):
    with pytest.raises(ScoreError, match=r"no metric 'rmse\.speed'; there are rmse\.position"):
        score(run.plan(), [], state_groups=GROUPS, expectations=[Expectation("rmse.speed", at_most=1)])


def test_an_incomplete_run_does_not_pass(run):
    records = [record for record in run.records() if record[1].step < 50]
    result = score(
        run.plan(), records, state_groups=GROUPS, expectations=[Expectation("divergences", equals=1)]
    )
    assert result.expectations[0].passed
    assert not result.passed
