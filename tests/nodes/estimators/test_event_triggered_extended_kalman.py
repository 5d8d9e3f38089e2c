"""The distributed filter of Zhou 2020: its oracles, its slots, and what it makes of losses."""

from __future__ import annotations

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from scipy.stats import chi2

from bus.packets import Packet
from nodes.contract import Setting
from nodes.estimators.event_triggered_extended_kalman import EventTriggeredExtendedKalman, GainDesign
from nodes.estimators.innovation_exchange import QUIET, SENT, UNMEASURED
from nodes.gaussian import Gaussian
from nodes.plants.linear import Linear as LinearPlant
from nodes.plants.planar_robot import PlanarRobot
from nodes.sensors.ceiling_camera import CeilingCamera
from nodes.sensors.linear import Linear as LinearSensor
from tests.nodes.estimators.camera_network import Cameras, all_pairs, attack, cameras, drive

FALSE_ALARM = 1e-6
A = [[0.95, 0.2, 0.0], [0.0, 1.0, 0.1], [-0.1, 0.0, 0.9]]
LINEAR = LinearPlant(
    0.1,
    A=A,
    process_noise=Gaussian(covariance=[[0.02, 0.01, 0.0], [0.01, 0.03, 0.0], [0.0, 0.0, 0.05]]),
    initial=Gaussian(std=[1.0, 0.5, 0.2], mean=[1.0, -1.0, 0.5]),
)


def linear_network(nodes, sigma=None):
    sensor = LinearSensor(LINEAR, C=[[1.0, 0.0, 1.0], [0.0, 1.0, 0.0]], noise=Gaussian(std=[0.3, 0.5]))
    sensors = {f"s{i + 1}": sensor for i in range(nodes)}
    return Cameras(LINEAR, sensors, all_pairs(nodes), {}, sigma=sigma)


@pytest.mark.parametrize("nodes", [1, 4])
def test_without_attack_and_trigger_equal_sensors_make_it_the_centralised_kalman_predictor(nodes):
    """Filterpy, given the measurements of all nodes; its prediction is what each node publishes."""
    network, rng = linear_network(nodes), np.random.default_rng(1)
    sensor = network.sensors["s1"]
    oracle = KalmanFilter(dim_x=3, dim_z=2 * nodes)
    oracle.x, oracle.P = LINEAR.initial_mean[:, None].copy(), LINEAR.initial_covariance.copy()
    oracle.F, oracle.Q = LINEAR.A, LINEAR.Q
    oracle.H, oracle.R = np.tile(sensor.C, (nodes, 1)), np.kron(np.eye(nodes), sensor.R)
    state = LINEAR.initial_state(rng)
    for step in range(30):
        measured = [sensor.observe(step, state, rng) for _ in range(nodes)]
        network.step(step, measured)
        oracle.update(np.concatenate(measured)[:, None])
        oracle.predict()
        for node in network.nodes:
            belief = node.estimate(step)
            assert belief.refers_to == step + 1
            np.testing.assert_allclose(belief.state, oracle.x[:, 0], atol=1e-9)
            np.testing.assert_allclose(belief.covariance, oracle.P, atol=1e-9)
        state = LINEAR.advance(step, state, rng)


def test_its_errors_are_as_large_as_it_claims_over_independent_runs():
    runs, nees = 80, 0.0
    for seed in range(runs):
        network, rng = linear_network(2), np.random.default_rng(seed)
        state = LINEAR.initial_state(rng)
        for step in range(6):
            network.step(step, [s.observe(step, state, rng) for s in network.sensors.values()])
            state = LINEAR.advance(step, state, rng)
        belief = network.nodes[0].estimate(5)
        nees += float((belief.state - state) @ np.linalg.solve(belief.covariance, belief.state - state))
    low, high = chi2.interval(1.0 - FALSE_ALARM, df=3 * runs)
    assert low < nees < high


def test_a_slot_carries_estimate_bound_flag_slack_and_when_sent_the_innovation():
    network, rng = cameras(), np.random.default_rng(0)
    state, flags = network.plant.initial_state(rng), []
    falsify = attack(5.0)
    sent: dict[int, np.ndarray] = {}
    for step in range(12):
        before = [(node._state, node._bound) for node in network.nodes]
        measured = [
            falsify(step, i, s.observe(step, state, rng)) for i, s in enumerate(network.sensors.values())
        ]
        last = dict(sent)
        for i, values in enumerate(network.step(step, measured)):
            innovation = measured[i] - network.sensors[f"s{i + 1}"].measure(before[i][0][None])[0]
            np.testing.assert_array_equal(values[:3], before[i][0])
            np.testing.assert_array_equal(values[3:9], before[i][1][np.triu_indices(3)])
            flags.append(values[9])
            others = [last[j] - last[i] for j in range(8) if j != i and last]
            disagreement = np.sum(others, axis=0) if others else np.zeros(2)
            threshold = 0.02 * disagreement @ disagreement
            if values[9] == SENT:
                assert values.size == 13
                np.testing.assert_allclose(values[11:], innovation, rtol=1e-12)
                assert not last or np.sum((innovation - last[i]) ** 2) > threshold
                sent[i] = innovation
            else:
                assert values.size == 11
                assert values[10] == pytest.approx(threshold, rel=1e-12)
                assert np.sum((innovation - last[i]) ** 2) <= threshold
        state = network.plant.advance(step, state, rng)
    assert set(flags[:8]) == {SENT}
    assert set(flags) == {SENT, QUIET}


def test_what_an_attacked_innovation_is_made_of_can_be_said_in_two_ways():
    """``(I - Xi)(H e + b + v) + Xi (v_a - h)`` and ``H e + b + v + Xi (v_a - y)``, b being the remainder."""
    rng = np.random.default_rng(4)
    for camera in cameras().sensors.values():
        x, guess, noise = rng.normal(size=3), rng.normal(size=3), rng.normal(size=2)
        xi, value = rng.uniform(0.1, 1.5, 2), rng.normal(size=2)
        predicted, e = camera.measure(guess[None])[0], x - guess
        genuine = camera.measure(x[None])[0] + noise
        remainder = camera.measure(x[None])[0] - predicted - camera.jacobian(guess) @ e
        innovation = (1.0 - xi) * genuine + xi * value - predicted
        seen = camera.jacobian(guess) @ e + remainder + noise
        np.testing.assert_allclose(innovation, (1.0 - xi) * seen + xi * (value - predicted), atol=1e-10)
        np.testing.assert_allclose(innovation, seen + xi * (value - genuine), atol=1e-10)


def test_the_cost_of_a_loss_is_that_the_neighbour_is_left_out_until_it_sends_again():
    network, rng = cameras(3), np.random.default_rng(2)
    state, heard = network.plant.initial_state(rng), []
    falsify, flags = attack(5.0), []
    for step in range(12):
        measured = [
            falsify(step, i, s.observe(step, state, rng)) for i, s in enumerate(network.sensors.values())
        ]
        lost = frozenset({(1, 0)}) if step == 2 else frozenset()
        payloads = network.step(step, measured, lost)
        flags.append(payloads[1][9])
        heard.append(network.nodes[0].estimate(step).diagnostics["neighbours_heard"])
        state = network.plant.advance(step, state, rng)
    again = next(step for step in range(3, 12) if flags[step] == SENT)
    assert heard[2:again] == [1.0] * (again - 2)
    assert heard[:2] + heard[again:] == [2.0] * (2 + 12 - again)


def test_without_any_neighbour_it_is_the_filter_of_a_node_alone():
    network, alone = cameras(3), cameras(3, edges=[])
    rng, falsify = np.random.default_rng(3), attack(5.0)
    state = network.plant.initial_state(rng)
    everything = frozenset((i, j) for i in range(3) for j in range(3))
    for step in range(10):
        measured = [
            falsify(step, i, s.observe(step, state, rng)) for i, s in enumerate(network.sensors.values())
        ]
        network.step(step, measured, everything)
        alone.step(step, measured)
        state = network.plant.advance(step, state, rng)
    for one, other in zip(network.nodes, alone.nodes, strict=True):
        np.testing.assert_allclose(one.estimate(9).state, other.estimate(9).state, rtol=1e-9, atol=1e-12)


def test_a_node_without_measurement_says_so_and_follows_its_neighbours():
    network, rng = cameras(4, start_error=Gaussian(std=0.0)), np.random.default_rng(5)
    still = cameras(4, start_error=Gaussian(std=0.0))
    state, falsify = network.plant.initial_state(rng), attack(5.0)
    for step in range(4):
        genuine = [s.observe(step, state, rng) for s in network.sensors.values()]
        measured = [falsify(step, i, values) for i, values in enumerate(genuine)]
        payloads = network.step(step, [None, *measured[1:]] if step == 3 else measured)
        still.step(step, measured if step < 3 else [None] * 4)
        state = network.plant.advance(step, state, rng)
    assert payloads[0][9] == UNMEASURED
    assert payloads[0].size == 11
    assert network.nodes[1].estimate(3).diagnostics["neighbours_heard"] == 2.0
    moved = network.nodes[0].estimate(3).state - still.nodes[0].estimate(3).state
    assert np.linalg.norm(moved) > 1e-3
    assert np.isfinite(network.nodes[0].estimate(3).covariance).all()


@pytest.mark.parametrize(
    "spoil",
    [
        lambda values: values[:-1],
        lambda values: np.concatenate((values, [1.0])),
        lambda values: np.where(np.arange(values.size) == 3, -1.0, values),
        lambda values: np.where(np.arange(values.size) == 10, -1.0, values),
        lambda values: values[:0],
    ],
    ids=["short", "long", "indefinite", "negative slack", "empty"],
)
def test_a_malformed_payload_counts_as_lost(spoil):
    network, other = cameras(3), cameras(3)
    measured = [np.array([1.0, 2.0])] * 3
    for one, broken in ((network, True), (other, False)):
        payloads = [node.correct(0, [_packet(f"s{i + 1}", measured[i])]) for i, node in enumerate(one.nodes)]
        inbox = [_packet("e2", spoil(payloads[1]))] if broken else []
        one.nodes[0].exchange(0, 0, [*inbox, _packet("e3", payloads[2])])
    np.testing.assert_array_equal(network.nodes[0].estimate(0).state, other.nodes[0].estimate(0).state)
    assert network.nodes[0].estimate(0).diagnostics["neighbours_heard"] == 1.0


def _packet(source, values):
    return Packet(source, 0, 0, "any", values)


@pytest.mark.parametrize("design", [GainDesign(riccati="nominal"), GainDesign(riccati="residual")])
def test_the_word_on_its_bound_is_no(design):
    network = cameras(2, design=design)
    drive(network, 2, 5.0)
    assert network.nodes[0].estimate(1).diagnostics["bound_guaranteed"] == 0.0


def test_settings_that_it_cannot_use_are_refused_with_the_cure():
    plant = PlanarRobot(1.0)
    camera = CeilingCamera(plant, position=[0.0, 0.0], noise=Gaussian(std=1.0))
    rng = np.random.default_rng(0)
    with pytest.raises(ValueError, match="e1 listens to 2 sensors; give it exactly one"):
        EventTriggeredExtendedKalman(Setting("e1", plant, {"s1": camera, "s2": camera}, {}, rng))
    with pytest.raises(ValueError, match="e2 listens to 0 sensors"):
        EventTriggeredExtendedKalman(
            Setting("e1", plant, {"s1": camera}, {"e2": 1.0}, rng, neighbour_sensors={"e2": {}})
        )
    with pytest.raises(ValueError, match="the sensors of e2 are not known"):
        EventTriggeredExtendedKalman(Setting("e1", plant, {"s1": camera}, {"e2": 1.0}, rng))
    other = LinearSensor(plant, C=[[1.0, 0.0, 0.0]], noise=Gaussian(std=1.0))
    with pytest.raises(ValueError, match=r"have \[1, 2\] outputs"):
        EventTriggeredExtendedKalman(
            Setting("e1", plant, {"s1": camera}, {"e2": 1.0}, rng, neighbour_sensors={"e2": {"s2": other}})
        )
    exact = PlanarRobot(1.0, initial=Gaussian(std=0.0))
    with pytest.raises(ValueError, match="give 'initial' a positive std"):
        EventTriggeredExtendedKalman(Setting("e1", exact, {"s1": camera}, {}, rng))
    with pytest.raises(ValueError, match="exactly one of 'riccati' and 'lmi'"):
        GainDesign(riccati="nominal", lmi="nominal")
    with pytest.raises(ValueError, match="size_weights"):
        cameras(1, size_weights=[1.0, 1.0])
