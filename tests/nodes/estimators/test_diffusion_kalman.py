from __future__ import annotations

import numpy as np
from scipy.stats import chi2

from nodes.estimators.diffusion_kalman import DiffusionKalman
from nodes.estimators.kalman import Kalman
from nodes.estimators.kalman_centralized import KalmanCentralized
from tests.nodes.estimators.network_play import (
    alone,
    assert_equal_beliefs,
    complete,
    errors_and_nees,
    ring,
)


def test_one_node_is_a_kalman_filter():
    network = ring()
    _, packets = network.trial(1, 30)
    own = [[p for p in row if p.source == "s2"] for row in packets]
    node = DiffusionKalman(network.setting("e2", neighbours=False))
    assert node.rounds == 0
    for belief, local in zip(alone(node, own), alone(Kalman(network.hearing("s2")), own), strict=True):
        assert_equal_beliefs(belief, local)


def test_on_a_complete_graph_it_is_the_centralised_filter():
    network = complete()
    _, packets = network.trial(1, 30)
    centralised = alone(KalmanCentralized(network.hearing()), packets)
    for row, whole in zip(network.play(DiffusionKalman, packets), centralised, strict=True):
        for belief in row:
            assert_equal_beliefs(belief, whole)


def test_the_state_is_the_mean_of_the_neighbourhoods_filters_and_the_covariance_the_nodes_own():
    network = ring()
    _, packets = network.trial(2, 1)
    beliefs = network.play(DiffusionKalman, packets)[0]
    local = []
    for name in network.names:
        heard = network.neighbourhood(name)
        local.append(
            alone(Kalman(network.hearing(*heard)), [[p for p in packets[0] if p.source in heard]])[0]
        )
    for i in range(5):
        mean = np.mean([local[j % 5].state for j in (i - 1, i, i + 1)], axis=0)
        np.testing.assert_allclose(beliefs[i].state, mean, atol=1e-10)
        np.testing.assert_allclose(beliefs[i].covariance, local[i].covariance, atol=1e-10)


def test_a_lost_round_leaves_a_kalman_filter_of_what_arrived():
    network = ring()
    _, packets = network.trial(3, 20)
    beliefs = network.play(DiffusionKalman, packets, lambda step, round_, source, to: round_ == 0)
    heard = network.neighbourhood("e1")
    own = [[p for p in row if p.source in heard] for row in packets]
    for row, local in zip(beliefs, alone(Kalman(network.hearing(*heard)), own), strict=True):
        assert_equal_beliefs(row[0], local)


def test_on_a_complete_graph_it_is_consistent():
    """Mean NEES of the last step of one node over 200 runs; false-alarm rate 1e-6."""
    _, nees, _ = errors_and_nees(complete(4), DiffusionKalman, 200, 12)
    low, high = chi2.interval(1 - 1e-6, df=200 * 3)
    assert low < nees[:, 0].sum() < high


def test_the_mean_of_states_lessens_the_error_on_a_ring():
    """By nature its covariance leaves the mean out; what is promised is a smaller error, over 150 runs."""
    network = ring()
    with_mean, _, _ = errors_and_nees(network, DiffusionKalman, 150, 12)
    squares = 0.0
    for run in range(150):
        states, packets = network.trial(5000 + run, 12)
        beliefs = network.play(DiffusionKalman, packets, lambda step, round_, source, to: round_ == 0)[-1]
        squares += sum(float(np.sum((belief.state - states[-1]) ** 2)) for belief in beliefs)
    assert float(np.sum(with_mean**2)) < 0.97 * squares
