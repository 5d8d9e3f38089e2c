"""NEES and NIS: known answers, and the nominal rate for filters that are consistent by construction."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace
from scipy import stats

from orchestrator.score.catalogue import METRICS
from orchestrator.score.consistency import chi_square_bounds, consistency, nees
from orchestrator.score.measure import measure
from orchestrator.score.remarks import remarks
from orchestrator.score.scoring import score


def test_nees_is_the_error_weighted_by_the_inverse_covariance():
    error = np.array([[[1.0, 2.0]]])
    covariance = np.array([[[[2.0, 0.5], [0.5, 1.0]]]])
    expected = error[0, 0] @ np.linalg.inv(covariance[0, 0]) @ error[0, 0]
    assert nees(error, covariance, np.array([[True]]))[0, 0] == pytest.approx(expected)


def test_a_covariance_that_is_not_positive_definite_gives_no_nees_and_spoils_no_other():
    error = np.ones((1, 4, 2))
    covariance = np.stack([np.eye(2), np.diag([1.0, -1.0]), np.zeros((2, 2)), np.full((2, 2), np.nan)])[None]
    figures = nees(error, covariance, np.ones((1, 4), dtype=bool))
    np.testing.assert_array_equal(figures, [[2.0, np.nan, np.nan, np.nan]])


def test_bounds_are_those_of_the_chi_square_law():
    low, high = chi_square_bounds(np.array([1, 3, 450]), 0.95)
    np.testing.assert_allclose(np.stack([low, high]), stats.chi2.interval(0.95, [1, 3, 450]), rtol=1e-9)


def test_means_take_each_step_with_its_own_degrees_of_freedom():
    figures = np.array([[1.0, 4.0, 0.0, np.nan]])
    dof = np.array([[1, 2, 0, 1]])
    (row,) = consistency(figures, dof, np.ones((1, 4), dtype=bool), 0.9)
    low, high = stats.chi2.interval(0.9, 3)
    assert (row.samples, row.mean, row.dof, row.inside) == (2, 2.5, 1.5, 1.0)
    assert (row.low, row.high) == (pytest.approx(low / 2), pytest.approx(high / 2))


def test_a_consistent_filter_lies_within_the_bounds_at_the_nominal_rate(make_plan, make_network):
    """Errors and NIS are drawn from their nominal laws, independently: the bounds hold in 95 % of runs.

    200 independent estimators of 60 steps; false-alarm rate of this test 1e-6 for each figure.
    """
    runs = [make_network(steps=60, nodes=20, seed=seed, attacked={}, diverging={}) for seed in range(10)]
    nodes = [
        node
        for run in runs
        for node in score(run.plan(), run.records(), state_groups={"position": [0]}).nodes
    ]
    fewest, most = stats.binom.interval(1 - 1e-6, len(nodes), 0.95)
    for figure in ("nees", "nis"):
        rows = [getattr(node, figure) for node in nodes]
        assert fewest <= sum(row.low <= row.mean <= row.high for row in rows) <= most
        fewest_steps, most_steps = stats.binom.interval(1 - 1e-6, 60 * len(nodes), 0.95)
        assert fewest_steps <= sum(row.inside * row.samples for row in rows) <= most_steps


def test_an_overconfident_filter_lies_above_the_bounds(make_network):
    run = make_network(attacked={}, error_scale=1.5)
    for node in score(run.plan(), run.records(), state_groups={}).nodes:
        assert node.nees.mean > node.nees.high


def _kalman_run(rng: np.random.Generator, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Return NEES and NIS (steps,) of a stationary Kalman filter that knows its scalar plant."""
    Q, R = 0.01, 1.0
    prior = (Q + np.sqrt(Q * Q + 4.0 * Q * R)) / 2.0
    gain = prior / (prior + R)
    error = rng.normal(0.0, np.sqrt(prior))
    figures = np.empty((2, steps))
    for step in range(steps):
        innovation = error + rng.normal(0.0, np.sqrt(R))
        posterior = error - gain * innovation
        figures[:, step] = posterior**2 / ((1.0 - gain) * prior), innovation**2 / (prior + R)
        error = posterior + rng.normal(0.0, np.sqrt(Q))
    return figures[0], figures[1]


def test_the_mean_nees_of_one_run_leaves_its_bounds_more_often_than_the_mean_nis():
    """NIS samples are independent and NEES samples are not, as the documentation warns.

    300 independent runs; false-alarm rate for the NIS 1e-6.
    """
    rng = np.random.default_rng(3)
    rows = np.array([_kalman_run(rng, 100) for _ in range(300)])
    outside = {}
    for figure, values in zip(("nees", "nis"), rows.transpose(1, 0, 2), strict=True):
        every = np.ones(values.shape, dtype=bool)
        found = consistency(values, every.astype(np.int64), every, 0.95)
        outside[figure] = sum(not row.low <= row.mean <= row.high for row in found)
    fewest, most = stats.binom.interval(1 - 1e-6, 300, 0.05)
    assert fewest <= outside["nis"] <= most
    assert outside["nees"] > 100


def test_nis_is_split_by_attack(make_plan, recorder):
    for step in range(4):
        attacked = step >= 2
        recorder.truth(step, [0.0])
        recorder.inbox("e1", step, [("s1", step)])
        recorder.channel(step, events=[("s1->e1", "bias", step, "attacked")] if attacked else [])
        recorder.estimate("e1", step, [0.0], [1.0], nis=9.0 if attacked else 1.0, nis_dof=1)
    node = score(make_plan(4, {"e1": ["s1"]}), recorder.records, state_groups={}).nodes[0]
    assert (node.nis.mean, node.nis_attacked.mean, node.nis_unattacked.mean) == (5.0, 9.0, 1.0)


def test_an_estimator_without_covariance_has_no_nees(make_plan, recorder):
    recorder.truth(0, [0.0])
    recorder.estimate("e1", 0, [1.0])
    node = score(make_plan(1, {"e1": ["s1"]}), recorder.records, state_groups={}).nodes[0]
    assert (node.nees.samples, node.nees.mean, node.nees_undefined) == (0, None, 1)


def test_a_bound_is_left_where_the_nees_exceeds_the_size_of_the_state(make_plan, recorder):
    said = (1.0, 1.0, 0.0, 1.0)
    for step, state in enumerate(([1.0, 0.9], [1.0, 1.1], [0.0, 0.0], [5.0, 0.0])):
        recorder.truth(step, [0.0, 0.0])
        recorder.estimate("e1", step, state, [1.0, 0.0, 0.0, 1.0])
        recorder.estimate("e2", step, state, [1.0, 0.0, 0.0, 1.0])
        topic, message = recorder.records[-2]
        told = replace(message, diagnostic_name=["bound_guaranteed"], diagnostic_value=[said[step]])
        recorder.records[-2] = topic, told
    plan = make_plan(4, {"e1": ["s1"], "e2": ["s1"]})
    whole = score(plan, recorder.records, state_groups={})
    assert [node.bound.outside for node in whole.nodes] == [0.5, 0.5]
    assert [node.bound.guaranteed for node in whole.nodes] == [False, None]
    metrics = ("bound.outside", "bound.guaranteed")
    found = [measure(whole, name, METRICS[name], ["e1"])[0][1] for name in metrics]
    assert found == [0.5, 0.0]
    early = [record for record in recorder.records if record[1].step < 2]
    until = score(make_plan(2, {"e1": ["s1"], "e2": ["s1"]}), early, state_groups={})
    assert until.nodes[0].bound.guaranteed is True
    assert "guaranteed bound left 50 %" in remarks(until.nodes[0], until)
