from dataclasses import replace

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from nodes.estimators.kalman import Kalman
from nodes.gaussian import Gaussian
from nodes.sensors.linear import Linear as LinearSensor

FALSE_ALARM = 1e-6


def oracle(world):
    """Return filterpy's filter before step 0."""
    kf = KalmanFilter(dim_x=3, dim_z=1)
    kf.x, kf.P = world.plant.initial_mean.copy(), world.plant.initial_covariance.copy()
    kf.F, kf.Q = world.plant.A, world.plant.Q
    return kf


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), arrives=st.lists(st.tuples(st.booleans(), st.booleans()), max_size=25))
def test_it_equals_the_filter_of_another_library_whatever_is_lost(world, seed, arrives):
    kalman, kf = Kalman(world.setting("s1", "s2")), oracle(world)
    _, packets = world.trial(seed, len(arrives) + 1)
    for step, delivered in enumerate(arrives):
        inbox = [p for p, came in zip(packets[step], delivered, strict=True) if came]
        kalman.correct(step, inbox)
        if step > 0:
            kf.predict()
        for p in inbox:
            kf.dim_z = len(p.values)
            kf.update(p.values, R=world.sensors[p.source].R, H=world.sensors[p.source].C)
        belief = kalman.estimate(step)
        np.testing.assert_allclose(belief.state, kf.x, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(belief.covariance, kf.P, rtol=1e-9, atol=1e-9)
        assert np.array_equal(belief.covariance, belief.covariance.T)


def test_errors_and_innovations_are_as_large_as_it_claims(world):
    runs, steps = 300, 12
    nees, nis, dof = [], [], 0
    for seed in range(runs):
        kalman = Kalman(world.setting("s1", "s2"))
        states, packets = world.trial(seed, steps)
        for step in range(steps):
            kalman.correct(step, packets[step])
            belief = kalman.estimate(step)
            nis.append(belief.nis)
            dof += belief.nis_dof
        error = belief.state - states[-1]
        nees.append(error @ np.linalg.solve(belief.covariance, error))
    low, high = chi2.interval(1.0 - FALSE_ALARM, df=3 * runs)
    assert low < sum(nees) < high
    low, high = chi2.interval(1.0 - FALSE_ALARM, df=dof)
    assert dof == 3 * runs * steps
    assert low < sum(nis) < high


def test_a_step_without_packets_only_predicts(world, packet):
    kalman = Kalman(world.setting("s1"))
    kalman.correct(0, [packet(0, "s1", [1.0])])
    before = kalman.estimate(0)
    assert kalman.correct(1, []) is None
    after = kalman.estimate(1)
    np.testing.assert_allclose(after.state, world.plant.A @ before.state, rtol=1e-14)
    assert (after.nis, after.nis_dof) == (0.0, 0)
    assert np.linalg.eigvalsh(after.covariance - world.plant.Q)[0] > -1e-12


def test_the_prior_of_step_0_is_the_plants_initial_law(world):
    kalman = Kalman(world.setting("s1"))
    kalman.correct(0, [])
    np.testing.assert_array_equal(kalman.estimate(0).state, world.plant.initial_mean)
    np.testing.assert_array_equal(kalman.estimate(0).covariance, world.plant.initial_covariance)


def test_a_late_packet_and_a_copy_change_nothing(world, packet):
    plain, disturbed = Kalman(world.setting("s1")), Kalman(world.setting("s1"))
    for step in range(3):
        current = packet(step, "s1", [float(step)])
        plain.correct(step, [current])
        disturbed.correct(step, [packet(step - 1, "s1", [99.0]), current, current])
    assert np.array_equal(plain.estimate(2).state, disturbed.estimate(2).state)
    assert plain.estimate(2).nis_dof == disturbed.estimate(2).nis_dof == 1


def test_what_it_published_does_not_change_afterwards(world):
    kalman = Kalman(world.setting("s1", "s2"))
    _, packets = world.trial(0, 3)
    kalman.correct(0, packets[0])
    belief = kalman.estimate(0)
    state, covariance = belief.state.copy(), belief.covariance.copy()
    kalman.correct(1, packets[1])
    kalman.correct(2, packets[2])
    assert np.array_equal(belief.state, state)
    assert np.array_equal(belief.covariance, covariance)


def test_it_works_alone(world):
    kalman = Kalman(world.setting("s1"))
    assert kalman.rounds == 0
    assert Kalman.listens == "paired"
    assert kalman.exchange(0, 0, []) is None


def test_a_plant_or_sensor_that_is_not_linear_is_refused(world, not_linear):
    setting = world.setting("s1")
    with pytest.raises(ValueError, match="e1: plant SimpleNamespace is not linear; use a linear plant"):
        Kalman(replace(setting, plant=not_linear.plant))
    with pytest.raises(ValueError, match=r"sensor s9 .* is not linear; use a linear sensor"):
        Kalman(replace(setting, sensors={"s9": not_linear.sensor}))


def test_a_sensor_without_noise_is_refused(world):
    exact = LinearSensor(world.plant, C=[[1.0, 0.0, 0.0]], noise=Gaussian(std=0.0))
    with pytest.raises(ValueError, match="sensor s1 has singular noise; give it a positive std"):
        Kalman(replace(world.setting("s1"), sensors={"s1": exact}))
