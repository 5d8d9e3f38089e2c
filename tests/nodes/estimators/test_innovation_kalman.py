from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from bus.packets import Packet
from nodes.contract import Setting
from nodes.estimators.innovation_kalman import InnovationKalman
from nodes.estimators.kalman import Kalman
from nodes.gaussian import Gaussian
from nodes.plants.linear import Linear as LinearPlant
from nodes.sensors.innovation import Innovation
from nodes.sensors.linear import Linear

FALSE_ALARM = 1e-6
MODEL = {"C": [[1.0, 0.0]], "noise": Gaussian(std=0.3)}
PLANT = LinearPlant(
    1.0,
    A=[[0.95, 0.2], [-0.2, 0.95]],
    process_noise=Gaussian(std=0.1),
    initial=Gaussian(std=1.0, mean=[3.0, -1.0]),
)


def setting(sensor):
    return Setting("e1", PLANT, {"s1": sensor}, {}, np.random.default_rng(0))


def trial(seed, steps):
    """Return the states, the innovations that a smart sensor sends, and what a plain one would."""
    rng, sensors = np.random.default_rng(seed), (Innovation(PLANT, **MODEL), Linear(PLANT, **MODEL))
    states = [PLANT.initial_state(rng)]
    for step in range(1, steps):
        states.append(PLANT.advance(step, states[-1], rng))
    noises = [np.random.default_rng(seed + 1) for _ in sensors]
    sent = [
        [sensor.observe(k, x, noise) for k, x in enumerate(states)]
        for sensor, noise in zip(sensors, noises, strict=True)
    ]
    return np.array(states), *sent


def packet(step, values):
    return Packet("s1", step, step, "measurement", np.array(values))


def test_without_losses_it_is_the_kalman_filter_of_the_measurements():
    remote, local = (
        InnovationKalman(setting(Innovation(PLANT, **MODEL))),
        Kalman(setting(Linear(PLANT, **MODEL))),
    )
    _, innovations, measurements = trial(0, 40)
    for step in range(40):
        remote.correct(step, [packet(step, innovations[step])])
        local.correct(step, [packet(step, measurements[step])])
        np.testing.assert_allclose(remote.estimate(step).state, local.estimate(step).state, atol=1e-9)
        np.testing.assert_allclose(
            remote.estimate(step).covariance, local.estimate(step).covariance, atol=1e-9
        )
        np.testing.assert_allclose(remote.estimate(step).nis, local.estimate(step).nis, rtol=1e-6, atol=1e-9)


def test_with_losses_its_errors_are_as_large_as_it_claims():
    runs, steps = 400, 15
    nees = 0.0
    for seed in range(runs):
        remote = InnovationKalman(setting(Innovation(PLANT, **MODEL)))
        states, innovations, _ = trial(1000 + 2 * seed, steps)
        losses = np.random.default_rng(seed).random(steps) < 0.4
        for step in range(steps):
            remote.correct(step, [] if losses[step] else [packet(step, innovations[step])])
        belief = remote.estimate(steps - 1)
        error = belief.state - states[-1]
        nees += error @ np.linalg.solve(belief.covariance, error)
    low, high = chi2.interval(1.0 - FALSE_ALARM, df=2 * runs)
    assert low < nees < high


def test_a_rejected_innovation_is_a_missing_one():
    _, innovations, _ = trial(1, 2)
    rejects = InnovationKalman(setting(Innovation(PLANT, **MODEL)), threshold=9.0, on_alarm="reject")
    flags = InnovationKalman(setting(Innovation(PLANT, **MODEL)), threshold=9.0)
    missing = InnovationKalman(setting(Innovation(PLANT, **MODEL)))
    for estimator in (rejects, flags, missing):
        estimator.correct(0, [packet(0, innovations[0])])
    rejects.correct(1, [packet(1, [100.0])])
    flags.correct(1, [packet(1, [100.0])])
    missing.correct(1, [])
    (detection,) = rejects.estimate(1).detections
    assert detection.alarm
    assert detection.statistic == rejects.estimate(1).nis > 9.0
    assert np.array_equal(rejects.estimate(1).state, missing.estimate(1).state)
    assert np.array_equal(rejects.estimate(1).covariance, missing.estimate(1).covariance)
    assert flags.estimate(1).state[0] > 20.0


def test_a_late_innovation_and_a_second_one_change_nothing():
    plain, disturbed = (InnovationKalman(setting(Innovation(PLANT, **MODEL))) for _ in range(2))
    for step in range(3):
        current = packet(step, [0.5])
        plain.correct(step, [current])
        disturbed.correct(step, [replace_step(current, step - 1), current, current])
    assert np.array_equal(plain.estimate(2).state, disturbed.estimate(2).state)


def replace_step(given, step):
    return Packet(given.source, step, step, given.kind, np.array([99.0]))


def test_other_sensors_than_one_smart_one_are_refused():
    smart = Innovation(PLANT, **MODEL)
    one = setting(smart)
    for sensors in ({}, {"s1": smart, "s2": smart}, {"s1": Linear(PLANT, **MODEL)}):
        with pytest.raises(ValueError, match="needs exactly one sensor of the kind 'innovation'"):
            InnovationKalman(replace(one, sensors=sensors))


def test_rejection_without_a_detector_is_refused():
    with pytest.raises(ValueError, match="without a detector nothing is rejected"):
        InnovationKalman(setting(Innovation(PLANT, **MODEL)), on_alarm="reject")


def test_a_filter_of_measurements_refuses_a_sensor_of_innovations():
    with pytest.raises(ValueError, match="s1 sends innovations, not measurements; use the method innovation"):
        Kalman(setting(Innovation(PLANT, **MODEL)))
