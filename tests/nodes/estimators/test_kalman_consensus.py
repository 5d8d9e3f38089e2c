from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from nodes.estimators.kalman import Kalman
from nodes.estimators.kalman_consensus import KalmanConsensus
from tests.nodes.estimators.network_play import alone, assert_equal_beliefs, errors_and_nees, ring


@pytest.mark.parametrize("shares", [True, False])
def test_without_gain_each_node_is_the_kalman_filter_of_what_it_hears(shares):
    network = ring()
    _, packets = network.trial(1, 30)
    beliefs = network.play(lambda s: KalmanConsensus(s, gain=0.0, share_measurements=shares), packets)
    for i, name in enumerate(network.names):
        heard = network.neighbourhood(name) if shares else ["s" + name[1:]]
        own = [[p for p in row if p.source in heard] for row in packets]
        for row, local in zip(beliefs, alone(Kalman(network.hearing(*heard)), own), strict=True):
            assert_equal_beliefs(row[i], local)


def test_one_step_is_what_the_algorithm_says():
    """In the second step, with the inverses written out."""
    network = ring()
    plant = network.plant
    _, packets = network.trial(2, 2)
    first, second = network.play(lambda s: KalmanConsensus(s, gain=0.4), packets)
    A, Q = plant.A, plant.Q
    x = [A @ belief.state for belief in first]
    for i, name in enumerate(network.names):
        P = A @ first[i].covariance @ A.T + Q
        y, S = np.zeros(3), np.zeros((3, 3))
        for packet in packets[1]:
            if packet.source in network.neighbourhood(name):
                sensor = network.sensors[packet.source]
                y += sensor.C.T @ np.linalg.inv(sensor.R) @ packet.values
                S += sensor.C.T @ np.linalg.inv(sensor.R) @ sensor.C
        M = np.linalg.inv(np.linalg.inv(P) + S)
        gamma = 0.4 / (1.0 + np.sqrt(np.trace(P.T @ P)))
        pull = x[(i - 1) % 5] + x[(i + 1) % 5] - 2.0 * x[i]
        expected = x[i] + M @ (y - S @ x[i]) + gamma * P @ pull
        np.testing.assert_allclose(second[i].state, expected, atol=1e-10)
        np.testing.assert_allclose(second[i].covariance, M, atol=1e-10)


def test_without_gain_it_is_consistent():
    """Mean NEES of the last step of each node over 200 runs; false-alarm rate 1e-6 a node."""
    _, nees, _ = errors_and_nees(ring(), lambda s: KalmanConsensus(s, gain=0.0), 200, 12)
    low, high = chi2.interval(1 - 1e-6, df=200 * 3)
    assert ((low < nees.sum(axis=0)) & (nees.sum(axis=0) < high)).all()


def test_the_consensus_term_brings_the_nodes_together():
    """By nature its covariance leaves the term out; what is promised is agreement, over 100 runs."""
    spread = []
    for gain in (0.0, 0.5):
        errors, _, _ = errors_and_nees(ring(), lambda s: KalmanConsensus(s, gain=gain), 100, 12)  # noqa: B023
        spread.append(float(np.sum((errors - errors.mean(axis=1, keepdims=True)) ** 2)))
    assert spread[1] < 0.85 * spread[0]
