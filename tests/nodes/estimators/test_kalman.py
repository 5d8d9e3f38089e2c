from dataclasses import replace

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import binom, chi2

from bus.packets import Packet
from nodes.estimators.kalman import Kalman
from nodes.gaussian import Gaussian
from nodes.plants.linear import Linear as LinearPlant
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


@pytest.mark.parametrize("holds", [False, True])
def test_with_an_input_it_equals_the_filter_of_another_library_whatever_command_is_lost(world, holds):
    B = [[0.1, 0.0], [0.0, 1.0], [0.5, 0.5]]
    plant = LinearPlant(
        0.1,
        A=world.plant.A.tolist(),
        B=B,
        holds_input=holds,
        process_noise=Gaussian(covariance=world.plant.Q.tolist()),
        initial=Gaussian(std=1.0),
    )
    kalman = Kalman(replace(world.setting("s1"), plant=plant))
    kf = KalmanFilter(dim_x=3, dim_z=1, dim_u=2)
    kf.x, kf.P = plant.initial_mean.copy(), plant.initial_covariance.copy()
    kf.F, kf.Q, kf.B = plant.A, plant.Q, np.array(B)
    kf.H, kf.R = world.sensors["s1"].C, world.sensors["s1"].R
    rng = np.random.default_rng(5)
    _, packets = world.trial(5, 40)
    applied = np.zeros(2)
    for step, inbox in enumerate(packets):
        if step > 0:
            commanded = rng.standard_normal(2)
            arrived = bool(rng.random() < 0.7)
            applied = commanded if arrived else applied if holds else np.zeros(2)
            kalman.control(step - 1, [Packet("c1", step - 1, step - 1, "control", commanded)] * arrived)
            kf.predict(u=applied)
        kalman.correct(step, inbox[:1])
        kf.update(inbox[0].values)
        belief = kalman.estimate(step)
        np.testing.assert_allclose(belief.state, kf.x, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(belief.covariance, kf.P, rtol=1e-9, atol=1e-9)


def test_without_a_threshold_it_judges_nothing(world):
    kalman = Kalman(world.setting("s1"))
    kalman.correct(0, world.trial(0, 1)[1][0][:1])
    assert kalman.estimate(0).detections == ()


def test_the_statistic_of_a_packet_is_its_innovation_squared_under_its_own_covariance(world):
    kalman = Kalman(world.setting("s1", "s2"), threshold=5.0)
    _, packets = world.trial(2, 1)
    kalman.correct(0, packets[0])
    detections = kalman.estimate(0).detections
    for packet, detection in zip(packets[0], detections, strict=True):
        sensor = world.sensors[packet.source]
        innovation = packet.values - sensor.C @ world.plant.initial_mean
        S = sensor.C @ world.plant.initial_covariance @ sensor.C.T + sensor.R
        statistic = innovation @ np.linalg.solve(S, innovation)
        np.testing.assert_allclose(detection.statistic, statistic, rtol=1e-9)
        assert (detection.source, detection.sequence) == (packet.source, packet.sequence)
        assert detection.alarm == (statistic >= 5.0)


def test_without_an_attack_alarms_are_as_frequent_as_the_chi_squared_law_says(world):
    runs, steps, rate = 100, 12, 0.1
    threshold = float(chi2.isf(rate, df=1))
    alarms = 0
    for seed in range(runs):
        kalman = Kalman(world.setting("s1"), threshold=threshold)
        _, packets = world.trial(seed, steps)
        for step in range(steps):
            kalman.correct(step, packets[step][:1])
            alarms += sum(detection.alarm for detection in kalman.estimate(step).detections)
    low, high = binom.interval(1.0 - FALSE_ALARM, runs * steps, rate)
    assert low <= alarms <= high


def test_a_flagged_packet_is_used_and_a_rejected_one_left_out(world, packet):
    false = [packet(0, "s1", [100.0]), packet(0, "s2", [1.0, -1.0])]
    plain, without = Kalman(world.setting("s1", "s2")), Kalman(world.setting("s1", "s2"))
    flags = Kalman(world.setting("s1", "s2"), threshold=20.0)
    rejects = Kalman(world.setting("s1", "s2"), threshold=20.0, on_alarm="reject")
    for kalman in (plain, flags, rejects):
        kalman.correct(0, false)
    without.correct(0, false[1:])
    for kalman in (flags, rejects):
        assert [detection.alarm for detection in kalman.estimate(0).detections] == [True, False]
    assert np.array_equal(flags.estimate(0).state, plain.estimate(0).state)
    assert np.array_equal(rejects.estimate(0).state, without.estimate(0).state)
    assert rejects.estimate(0).nis == plain.estimate(0).nis


def test_when_all_are_rejected_it_only_predicts(world, packet):
    kalman = Kalman(world.setting("s1"), threshold=20.0, on_alarm="reject")
    kalman.correct(0, [packet(0, "s1", [100.0])])
    np.testing.assert_array_equal(kalman.estimate(0).state, world.plant.initial_mean)


def test_rejection_without_a_detector_is_refused(world):
    with pytest.raises(ValueError, match="without a detector nothing is rejected; give it a 'threshold'"):
        Kalman(world.setting("s1"), on_alarm="reject")
