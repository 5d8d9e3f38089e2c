from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from scipy.stats import chi2

from nodes.estimators.covariance_intersection import CovarianceIntersection, intersect, optimal_weights
from nodes.estimators.kalman import Kalman
from tests.nodes.estimators.network_play import alone, assert_equal_beliefs, errors_and_nees, ring

A = np.array([[1.0, 0.3], [0.3, 4.0]])
B = np.array([[3.0, -0.5], [-0.5, 0.8]])


def cost(P: np.ndarray, criterion: str) -> float:
    return float(np.trace(P)) if criterion == "trace" else float(np.linalg.slogdet(P)[1])


@pytest.mark.parametrize("criterion", ["trace", "determinant"])
@pytest.mark.parametrize("scale", [1.0, 1e-6, 1e6])
def test_of_two_estimates_it_finds_the_weight_that_a_scalar_search_finds(criterion, scale):
    def fused(w: float) -> np.ndarray:
        return np.linalg.inv(w * np.linalg.inv(scale * A) + (1 - w) * np.linalg.inv(scale * B))

    best = minimize_scalar(
        lambda w: cost(fused(w), criterion) / (scale if criterion == "trace" else 1.0),
        bounds=(0.0, 1.0),
        method="bounded",
        options={"xatol": 1e-10},
    ).x
    x, y = np.array([1.0, 2.0]), np.array([-1.0, 0.5])
    state, P = intersect([x, y], [scale * A, scale * B], criterion)
    np.testing.assert_allclose(P, fused(best), rtol=1e-4)
    assert cost(P / scale, criterion) == pytest.approx(cost(fused(best) / scale, criterion), abs=1e-8)
    weighted = best * np.linalg.solve(scale * A, x) + (1 - best) * np.linalg.solve(scale * B, y)
    np.testing.assert_allclose(state, fused(best) @ weighted, rtol=1e-4)


@pytest.mark.parametrize("criterion", ["trace", "determinant"])
def test_of_several_no_other_weights_are_better(criterion):
    rng = np.random.default_rng(0)
    roots = rng.normal(size=(5, 3, 3))
    informations = np.einsum("kij,klj->kil", roots, roots) + 0.1 * np.eye(3)
    weights = optimal_weights(informations, criterion)
    assert weights.min() >= 0.0
    assert weights.sum() == pytest.approx(1.0)
    best = cost(np.linalg.inv(np.tensordot(weights, informations, 1)), criterion)
    for other in rng.dirichlet(np.ones(5), size=2000):
        assert best <= cost(np.linalg.inv(np.tensordot(other, informations, 1)), criterion) + 1e-7


def test_an_estimate_that_is_worse_in_every_direction_gets_no_weight():
    state, P = intersect([np.zeros(2), np.ones(2)], [A, 5.0 * A], "trace")
    np.testing.assert_allclose(P, A, rtol=1e-6)
    np.testing.assert_allclose(state, 0.0, atol=1e-6)


def test_fast_weights_are_the_inverse_traces():
    _, P = intersect([np.zeros(2), np.zeros(2)], [A, B], "fast")
    w = (1 / np.trace(A)) / (1 / np.trace(A) + 1 / np.trace(B))
    np.testing.assert_allclose(P, np.linalg.inv(w * np.linalg.inv(A) + (1 - w) * np.linalg.inv(B)))


@pytest.mark.parametrize("criterion", ["trace", "determinant", "fast"])
def test_for_any_correlation_the_fused_error_stays_below_the_fused_covariance(criterion):
    """The joint covariance [[A, X], [X', B]] with X = L_A K L_B', |K| <= 1, runs over all that there are."""
    rng = np.random.default_rng(1)
    LA, LB = np.linalg.cholesky(A), np.linalg.cholesky(B)
    _, P = intersect([np.zeros(2), np.zeros(2)], [A, B], criterion)
    gains = [
        np.column_stack([intersect([x, np.zeros(2)], [A, B], criterion)[0] for x in np.eye(2)]),
        np.column_stack([intersect([np.zeros(2), x], [A, B], criterion)[0] for x in np.eye(2)]),
    ]
    for _ in range(300):
        K = rng.normal(size=(2, 2))
        X = LA @ (K / np.linalg.norm(K, 2)) @ LB.T
        joint = np.block([[A, X], [X.T, B]])
        gain = np.hstack(gains)
        assert np.linalg.eigvalsh(P - gain @ joint @ gain.T)[0] > -1e-9


def test_when_nothing_arrives_each_node_is_a_kalman_filter():
    network = ring()
    _, packets = network.trial(2, 20)
    beliefs = network.play(CovarianceIntersection, packets, lambda *_: False)
    for i, name in enumerate(network.names):
        own = [[p for p in row if p.source[1:] == name[1:]] for row in packets]
        for row, local in zip(beliefs, alone(Kalman(network.hearing("s" + name[1:])), own), strict=True):
            assert_equal_beliefs(row[i], local)


@pytest.mark.parametrize(("criterion", "loss"), [("trace", 0.0), ("fast", 0.3)])
def test_its_covariance_is_an_upper_bound_on_the_measured_one(criterion, loss):
    """Mean NEES of each node's last step over 100 runs: below the 1 - 1e-6 quantile of an exact filter.

    Without loss the covariance is the same in every run, and that of the errors is below it in every
    direction, up to the spread of the samples, which an exact filter leaves once in 1e6 (Davidson, Szarek
    2001).
    """
    runs, n = 100, 3
    errors, nees, P = errors_and_nees(
        ring(), lambda setting: CovarianceIntersection(setting, weights=criterion), runs, 4, loss
    )
    assert nees.sum(axis=0).max() < chi2.ppf(1 - 1e-6, df=runs * n)
    if loss == 0.0:
        for node in range(errors.shape[1]):
            np.testing.assert_allclose(P[:, node], P[:1, node].repeat(runs, axis=0), rtol=1e-9)
            measured = errors[:, node].T @ errors[:, node] / runs
            root = np.linalg.cholesky(P[0, node])
            whitened = np.linalg.solve(root, np.linalg.solve(root, measured).T)
            largest = 1.0 + np.sqrt(n / runs) + np.sqrt(2.0 * np.log(1e6) / runs)
            assert np.linalg.eigvalsh(whitened)[-1] < largest**2
