"""What all distributed filters have in common: inputs, models with Jacobians, and what they refuse."""

from __future__ import annotations

from dataclasses import replace

import networkx as nx
import numpy as np
import pytest

from bus.packets import Packet
from nodes.contract import Setting
from nodes.estimators.covariance_intersection import CovarianceIntersection
from nodes.estimators.diffusion_kalman import DiffusionKalman
from nodes.estimators.extended_kalman import ExtendedKalman
from nodes.estimators.information_consensus import InformationConsensus
from nodes.estimators.kalman import Kalman
from nodes.estimators.kalman_consensus import KalmanConsensus
from nodes.gaussian import Gaussian
from nodes.plants.linear import Linear as LinearPlant
from nodes.plants.quadruple_tank import QuadrupleTank
from nodes.sensors.linear import Linear as LinearSensor
from nodes.sensors.tank_outflow import TankOutflow
from tests.nodes.estimators.network_play import Network, alone, assert_equal_beliefs, ring

METHODS = [KalmanConsensus, InformationConsensus, DiffusionKalman, CovarianceIntersection]


def tanks() -> Network:
    plant = QuadrupleTank(0.5, process_noise=Gaussian(std=0.05), initial=Gaussian(std=0.5))
    sensors = {f"s{i}": TankOutflow(plant, tanks=[i, 5 - i], noise=Gaussian(std=0.3)) for i in (1, 2, 3)}
    return Network(plant, sensors, nx.relabel_nodes(nx.complete_graph(3), lambda i: i + 1))


@pytest.mark.parametrize("method", METHODS)
def test_alone_it_is_the_extended_filter_of_a_nonlinear_plant(method):
    network = tanks()
    _, packets = network.trial(1, 30)
    own = [[p for p in row if p.source == "s1"] for row in packets]
    node = method(network.setting("e1", neighbours=False))
    for belief, local in zip(
        alone(node, own), alone(ExtendedKalman(network.hearing("s1")), own), strict=True
    ):
        assert_equal_beliefs(belief, local, atol=1e-8)
        assert belief.nis == pytest.approx(local.nis)


@pytest.mark.parametrize(
    "make",
    [
        DiffusionKalman,
        lambda setting: InformationConsensus(setting, omega=3.0),
        lambda setting: KalmanConsensus(setting, gain=0.3),
    ],
)
def test_on_a_complete_graph_it_is_the_centralised_extended_filter(make):
    network = tanks()
    _, packets = network.trial(2, 30)
    centralised = alone(ExtendedKalman(network.hearing()), packets)
    for row, whole in zip(network.play(make, packets), centralised, strict=True):
        for belief in row:
            assert_equal_beliefs(belief, whole, atol=1e-8)


@pytest.mark.parametrize("method", METHODS)
def test_it_takes_a_commanded_input_into_account(method):
    plant = LinearPlant(0.1, A=[[0.9]], B=[[1.0]], process_noise=Gaussian(std=0.1), initial=Gaussian(std=1.0))
    sensor = LinearSensor(plant, C=[[1.0]], noise=Gaussian(std=0.3))
    setting = Setting("e1", plant, {"s1": sensor}, {}, np.random.default_rng(0))
    own, plain = method(setting), Kalman(setting)
    for step in range(4):
        for node in (own, plain):
            node.correct(step, [Packet("s1", step, step, "measurement", np.array([float(step)]))])
            node.control(step, [Packet("c1", step, step, "control", np.array([2.0 + step]))])
        assert_equal_beliefs(own.estimate(step), plain.estimate(step))


@pytest.mark.parametrize("method", METHODS)
def test_late_and_malformed_payloads_count_as_lost(method):
    network = ring()
    setting = network.setting("e1")
    own, spared = method(setting), method(setting)
    _, packets = network.trial(1, 2)
    for step in range(2):
        size = own.correct(step, packets[step][:1]).size
        spared.correct(step, packets[step][:1])
        bad = [
            Packet("e2", step - 1, 0, "exchange", np.ones(size)),
            Packet("e5", step, 0, "exchange", np.ones(size + 1)),
        ]
        for round_ in range(own.rounds):
            own.exchange(step, round_, bad)
            spared.exchange(step, round_, [])
        assert np.array_equal(own.estimate(step).state, spared.estimate(step).state)


@pytest.mark.parametrize("method", METHODS)
def test_a_singular_initial_law_is_refused(method):
    plant = LinearPlant(
        0.1, A=[[0.9, 0.0], [0.0, 0.9]], process_noise=Gaussian(std=0.1), initial=Gaussian(std=[1.0, 0.0])
    )
    sensor = LinearSensor(plant, C=[[1.0, 0.0]], noise=Gaussian(std=0.3))
    with pytest.raises(ValueError, match="e1: the plant's initial law is singular"):
        method(Setting("e1", plant, {"s1": sensor}, {}, np.random.default_rng(0)))


@pytest.mark.parametrize("method", METHODS)
def test_models_without_matrices_or_jacobians_are_refused(method, world, not_linear):
    with pytest.raises(ValueError, match="has no 'transition', 'jacobian' and 'Q'"):
        method(replace(world.setting("s1"), plant=not_linear.plant))
