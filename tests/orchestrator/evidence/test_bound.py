"""The posterior Cramer-Rao bound against another library's Kalman filter, and against Monte Carlo."""

from __future__ import annotations

import filterpy.kalman
import numpy as np
import pytest

from orchestrator.evidence.bound import information, posterior_bound
from orchestrator.evidence.innovations import whitened_innovations
from orchestrator.evidence.whiteness import whiteness

A = np.array([[1.0, 0.1, 0.005], [0.0, 1.0, 0.1], [0.0, 0.0, 1.0]])
G = np.array([[0.005], [0.1], [1.0]])
Q = 0.04 * G @ G.T  # singular
P0 = np.diag([1.0, 0.5, 0.0])  # singular too
C = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.3]])
R = np.diag([0.02, 0.3])


def kalman(arrived: np.ndarray, measured: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Return states (K, n) and covariances (K, n, n) of filterpy's filter."""
    own = filterpy.kalman.KalmanFilter(dim_x=3, dim_z=2)
    own.F, own.Q, own.P, own.x = A, Q, P0.copy(), np.zeros((3, 1))
    states, covariances = [], []
    for k, came in enumerate(arrived):
        if k:
            own.predict()
        for i in np.flatnonzero(came):
            value = 0.0 if measured is None else measured[k, i]
            own.update(np.array([[value]]), R=R[i : i + 1, i : i + 1], H=C[i : i + 1])
        states.append(own.x[:, 0].copy())
        covariances.append(own.P.copy())
    return np.array(states), np.array(covariances)


def test_the_bound_is_the_kalman_covariance_given_what_arrived() -> None:
    arrived = np.random.default_rng(1).random((4, 80, 2)) < [0.6, 0.3]
    told = np.array([information(C[i : i + 1], R[i : i + 1, i : i + 1]) for i in range(2)])
    bound = posterior_bound(A, Q, P0, told, arrived)
    for observer in range(4):
        assert bound[observer] == pytest.approx(kalman(arrived[observer])[1], rel=1e-10, abs=1e-12)


def test_without_any_measurement_the_bound_is_the_spread_of_the_plant() -> None:
    bound = posterior_bound(A, Q, P0, np.zeros((1, 3, 3)), np.zeros((1, 3, 1), dtype=bool))
    assert bound[0, 0] == pytest.approx(P0)
    assert bound[0, 2] == pytest.approx(A @ (A @ P0 @ A.T + Q) @ A.T + Q)


def run(rng: np.random.Generator, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Return which measurements arrived and all of them, (steps, 2) each."""
    x, rows = np.sqrt(np.diag(P0)) * rng.normal(size=3), []
    for k in range(steps):
        if k:
            x = A @ x + 0.2 * G[:, 0] * rng.normal()
        rows.append(C @ x + np.sqrt(np.diag(R)) * rng.normal(size=2))
    return rng.random((steps, 2)) < [0.8, 0.5], np.array(rows)


def test_innovations_from_the_record_are_those_of_the_filter_and_white() -> None:
    rng = np.random.default_rng(2)
    white = []
    for _ in range(30):
        arrived, measured = run(rng, 60)
        states, covariances = kalman(arrived, measured)
        seen = np.where(arrived, measured, np.nan)
        white.append(whitened_innovations(A, Q, C, R, states[:-1], covariances[:-1], seen[1:]))
    innovation = np.array(white)
    came = ~np.isnan(innovation)
    assert 0.7 < came[:, :, 0].mean() < 0.9
    # chi-square with as many degrees of freedom as components came; the false-alarm rate is below 1e-6
    total, count = np.sum(innovation[came] ** 2), came.sum()
    assert abs(total - count) < 4.9 * np.sqrt(2 * count)
    assert whiteness(innovation).p_value > 1e-6


def test_one_innovation_is_the_textbooks() -> None:
    state, covariance, y = np.array([1.0, 2.0, 3.0]), np.diag([1.0, 2.0, 0.5]), np.array([0.4, 2.5])
    S = C @ (A @ covariance @ A.T + Q) @ C.T + R
    expected = np.linalg.solve(np.linalg.cholesky(S), y - C @ A @ state)
    found = whitened_innovations(A, Q, C, R, state[None], covariance[None], y[None])
    assert found[0] == pytest.approx(expected)
    alone = whitened_innovations(A, Q, C, R, state[None], covariance[None], np.array([[np.nan, 2.5]]))
    assert np.isnan(alone[0, 0])
    assert alone[0, 1] == pytest.approx((2.5 - C[1] @ A @ state) / np.sqrt(S[1, 1]))
