from dataclasses import replace

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from scipy.linalg import solve_discrete_are

from bus.packets import Packet
from nodes.estimators.fixed_gain_consensus import FixedGainConsensus


def steady_state(world, C, R):
    """Return the gain (n, m) and the covariance (n, n) after a correction that a Kalman filter settles at."""
    P = solve_discrete_are(world.plant.A.T, C.T, world.plant.Q, R)
    gain = P @ C.T @ np.linalg.inv(C @ P @ C.T + R)
    return gain, (np.eye(3) - gain @ C) @ P


def test_with_the_steady_state_gain_it_becomes_the_kalman_filter_of_another_library(world):
    sensor = world.sensors["s2"]
    gain, settled = steady_state(world, sensor.C, sensor.R)
    fixed = FixedGainConsensus(world.setting("s2"), gain=gain.tolist(), coupling=0.0)
    kf = KalmanFilter(dim_x=3, dim_z=2)
    kf.x, kf.P, kf.F = world.plant.initial_mean.copy(), world.plant.initial_covariance.copy(), world.plant.A
    kf.Q, kf.H, kf.R = world.plant.Q, sensor.C, sensor.R
    _, packets = world.trial(5, 300)
    for step, inbox in enumerate(packets):
        fixed.correct(step, inbox[1:])
        if step > 0:
            kf.predict()
        kf.update(inbox[1].values)
    np.testing.assert_allclose(fixed.estimate(299).state, kf.x, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(fixed.estimate(299).covariance, settled, rtol=1e-9, atol=1e-9)


def test_it_is_the_observer_of_its_gain_and_draws_towards_those_neighbours_that_arrived(world):
    gain, C, kappa, weights = [0.3, 0.1, 0.2], world.sensors["s1"].C[0], 0.1, {"e2": 0.7, "e3": 0.3}
    fixed = FixedGainConsensus(world.setting("s1", neighbours=weights), gain=gain, coupling=kappa)
    _, packets = world.trial(6, 20)
    rng, expected, mixed = np.random.default_rng(0), world.plant.initial_mean, None
    for step, inbox in enumerate(packets):
        if step > 0:
            expected = world.plant.A @ mixed
        expected = expected + np.array(gain) * (inbox[0].values[0] - C @ expected)
        np.testing.assert_allclose(fixed.correct(step, inbox[:1]), expected, rtol=1e-12, atol=1e-12)
        received = {name: rng.standard_normal(3) for name in weights if rng.random() < 0.6}
        fixed.exchange(step, 0, [Packet(name, step, step, "exchange", x) for name, x in received.items()])
        mixed = expected + kappa * sum(
            (weights[j] * (x - expected) for j, x in received.items()), np.zeros(3)
        )
        belief = fixed.estimate(step)
        assert belief.diagnostics["neighbours_received"] == len(received)
        np.testing.assert_allclose(belief.state, expected, rtol=1e-12, atol=1e-12)


def test_its_covariance_is_that_of_its_own_errors_when_packets_are_lost(world, packet):
    gain = [[0.2, 0.1, 0.0], [0.1, 0.0, 0.2], [0.0, 0.3, 0.1]]
    fixed = FixedGainConsensus(world.setting("s1", "s2"), gain=gain, coupling=0.0)
    arrives = [("s1", "s2"), ("s2",), (), ("s1",), ("s2", "s1")]
    columns = {"s1": [0], "s2": [1, 2]}
    P = world.plant.initial_covariance
    for step, sources in enumerate(arrives):
        fixed.correct(step, [packet(step, s, np.zeros(len(columns[s]))) for s in sources])
        if step > 0:
            P = world.plant.A @ P @ world.plant.A.T + world.plant.Q
        reduction = np.eye(3)
        for s in sources:
            reduction = reduction - np.array(gain)[:, columns[s]] @ world.sensors[s].C
        P = reduction @ P @ reduction.T
        for s in sources:
            K = np.array(gain)[:, columns[s]]
            P = P + K @ world.sensors[s].R @ K.T
        np.testing.assert_allclose(fixed.estimate(step).covariance, P, rtol=1e-12, atol=1e-14)
        assert fixed.estimate(step).nis_dof == sum(len(columns[s]) for s in sources)


@pytest.mark.parametrize("gain", [[0.1, 0.2], [[0.1], [0.2]], [[0.1, 0.2]] * 3, []])
def test_a_gain_of_another_shape_is_refused(world, gain):
    with pytest.raises(ValueError, match=r"give 3 rows \(state components\) of 1 \(measured outputs\)"):
        FixedGainConsensus(world.setting("s1"), gain=gain, coupling=0.0)


def test_it_exchanges_only_where_there_is_somebody_to_exchange_with(world):
    gain = [0.1, 0.2, 0.3]
    assert FixedGainConsensus(world.setting("s1"), gain=gain, coupling=0.0).rounds == 0
    assert FixedGainConsensus(world.setting("s1"), gain=gain, coupling=0.1).rounds == 1
    with_neighbour = world.setting("s1", neighbours={"e2": 1.0})
    assert FixedGainConsensus(with_neighbour, gain=gain, coupling=0.0).rounds == 1


def test_a_payload_of_another_size_is_not_used(world):
    setting = replace(world.setting("s1"), neighbours={"e2": 1.0})
    fixed = FixedGainConsensus(setting, gain=[0.1, 0.2, 0.3], coupling=0.1)
    fixed.correct(0, [])
    fixed.exchange(0, 0, [Packet("e2", 0, 0, "exchange", np.zeros(12))])
    assert fixed.estimate(0).diagnostics["neighbours_received"] == 0
