from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from bus.packets import Packet
from nodes.estimators.information_consensus import InformationConsensus
from nodes.estimators.kalman import Kalman
from nodes.estimators.kalman_centralized import KalmanCentralized
from tests.nodes.estimators.network_play import (
    alone,
    assert_equal_beliefs,
    complete,
    errors_and_nees,
    ring,
)


@pytest.mark.parametrize("consensus_on", ["information", "measurements"])
@pytest.mark.parametrize(("network", "rounds"), [(complete(), 1), (ring(), 60)], ids=["complete", "ring"])
def test_with_rounds_enough_and_the_number_of_nodes_as_weight_it_is_the_centralised_filter(
    network, rounds, consensus_on
):
    """One round with Metropolis weights takes the mean on a complete graph; on a ring of 5, 0.54^60."""
    _, packets = network.trial(1, 30)
    beliefs = network.play(
        lambda setting: InformationConsensus(
            setting, rounds_per_step=rounds, omega=5.0, consensus_on=consensus_on
        ),
        packets,
    )
    for row, centralised in zip(beliefs, alone(KalmanCentralized(network.hearing()), packets), strict=True):
        for belief in row:
            assert_equal_beliefs(belief, centralised)


def test_when_nothing_arrives_each_node_is_a_kalman_filter():
    network = ring()
    _, packets = network.trial(2, 20)
    beliefs = network.play(
        lambda setting: InformationConsensus(setting, rounds_per_step=2), packets, lambda *_: False
    )
    for i, name in enumerate(network.names):
        own = [[p for p in row if p.source[1:] == name[1:]] for row in packets]
        for row, local in zip(beliefs, alone(Kalman(network.hearing("s" + name[1:])), own), strict=True):
            assert_equal_beliefs(row[i], local)
            assert row[i].nis == pytest.approx(local.nis)


def test_the_weight_of_a_lost_neighbour_falls_to_the_node_itself():
    network = ring()
    _, packets = network.trial(3, 1)
    own = [InformationConsensus(network.setting(name)) for name in network.names]
    payloads = [
        node.correct(0, [p for p in packets[0] if p.source == f"s{i + 1}"]) for i, node in enumerate(own)
    ]
    beliefs = network.play(
        InformationConsensus, packets, lambda k, r, source, to: (source, to) != ("e2", "e1")
    )
    mean = (2.0 * payloads[0] + payloads[4]) / 3.0
    P = np.linalg.inv(mean[3:].reshape(3, 3))
    np.testing.assert_allclose(beliefs[0][0].covariance, P, atol=1e-12)
    np.testing.assert_allclose(beliefs[0][0].state, P @ mean[:3], atol=1e-12)


@pytest.mark.parametrize("loss", [0.0, 0.3])
def test_with_unit_weight_its_covariance_is_an_upper_bound(loss):
    """Mean NEES of each node's last step over 200 runs: below the 1 - 1e-6 quantile of an exact filter."""
    _, nees, _ = errors_and_nees(
        ring(), lambda setting: InformationConsensus(setting, rounds_per_step=3), 200, 15, loss
    )
    assert nees.sum(axis=0).max() < chi2.ppf(1 - 1e-6, df=200 * 3)
    assert nees.mean() < 2.0  # of 3: it is loose


def test_with_too_few_rounds_the_number_of_nodes_as_weight_is_overconfident():
    """Over 60 runs, on a ring of 10 with one round; an exact filter would exceed the bound once in 1e6."""
    _, nees, _ = errors_and_nees(ring(10), lambda setting: InformationConsensus(setting, omega=10.0), 60, 15)
    assert nees.sum(axis=0).max() > chi2.ppf(1 - 1e-6, df=60 * 3)


def test_weights_that_leave_a_node_nothing_are_shared_with_it():
    network = complete(3)
    setting = replace(network.setting("e1"), neighbours={"e2": 0.5, "e3": 0.5})
    own, same = InformationConsensus(setting), InformationConsensus(network.setting("e1"))
    _, packets = network.trial(4, 1)
    others = network.play(InformationConsensus, packets)
    for node in (own, same):
        node.correct(0, [packets[0][0]])
    senders = {name: InformationConsensus(network.setting(name)) for name in ("e2", "e3")}
    heard = [
        Packet(name, 0, 0, "exchange", node.correct(0, [packets[0][int(name[1:]) - 1]]))
        for name, node in senders.items()
    ]
    for node in (own, same):
        node.exchange(0, 0, heard)
        assert_equal_beliefs(node.estimate(0), others[0][0])
    with pytest.raises(ValueError, match="set 'weights: metropolis'"):
        InformationConsensus(replace(setting, neighbours={"e2": 0.9, "e3": 0.5}))
