import numpy as np
import pytest
from scipy.stats import chi2, multivariate_normal

from nodes.estimators.kalman import Kalman
from nodes.estimators.packet_sets import FakeBox
from nodes.estimators.probabilistic_data_association import ProbabilisticDataAssociation as Association

FALSE_ALARM = 1e-6
BOX = FakeBox(-10.0, 10.0)


def test_it_is_bar_shaloms_filter_without_a_gate(world, packet):
    """The association weights and the spread of the innovations, as the textbooks write them."""
    association = Association(world.setting("s2"), fakes=BOX, delivery=0.8)
    sensor, rng = world.sensors["s2"], np.random.default_rng(0)
    x, P = world.plant.initial_mean, world.plant.initial_covariance
    for step in range(6):
        if step:
            x, P = world.plant.A @ x, world.plant.A @ P @ world.plant.A.T + world.plant.Q
        values = rng.normal(0.0, 2.0, (3, 2))
        association.correct(step, [packet(step, "s2", v) for v in values])
        S = sensor.C @ P @ sensor.C.T + sensor.R
        likelihood = multivariate_normal(sensor.C @ x, S).pdf(values)
        beta = np.append(3 * (1.0 - 0.8) / 0.8 / 400.0, likelihood)
        beta /= beta.sum()
        innovations = values - sensor.C @ x
        mean = beta[1:] @ innovations
        W = P @ sensor.C.T @ np.linalg.inv(S)
        spread = (beta[1:, None] * innovations).T @ innovations - np.outer(mean, mean)
        x = x + W @ mean
        P = P - (1.0 - beta[0]) * W @ S @ W.T + W @ spread @ W.T
        belief = association.estimate(step)
        np.testing.assert_allclose(belief.state, x, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(belief.covariance, P, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose([one.statistic for one in belief.detections], 1.0 - beta[1:], atol=1e-9)


def test_with_sure_delivery_and_no_fakes_it_is_the_kalman_filter(world):
    association, kalman = Association(world.setting("s1", "s2"), fakes=BOX), Kalman(world.setting("s1", "s2"))
    _, packets = world.trial(0, 10)
    for step in range(10):
        association.correct(step, packets[step])
        kalman.correct(step, packets[step])
        np.testing.assert_allclose(association.estimate(step).state, kalman.estimate(step).state, rtol=1e-9)
        np.testing.assert_allclose(
            association.estimate(step).covariance, kalman.estimate(step).covariance, rtol=1e-8
        )


def test_errors_and_innovations_under_fakes_are_as_large_as_it_claims(world, packet):
    """Fakes that are easily told apart; 300 independent runs, limits left once in a million campaigns."""
    runs, steps, nees, nis, dof = 300, 8, 0.0, 0.0, 0
    wide = FakeBox(-300.0, 300.0)
    for seed in range(runs):
        rng = np.random.default_rng(1000 + seed)
        association = Association(world.setting("s2"), fakes=wide, delivery=0.9)
        states, packets = world.trial(seed, steps)
        for step in range(steps):
            inbox = [p for p in packets[step] if p.source == "s2" and rng.random() < 0.9]
            inbox += [packet(step, "s2", v) for v in rng.uniform(-300.0, 300.0, (4, 2))]
            association.correct(step, inbox)
            belief = association.estimate(step)
            nis += belief.nis
            dof += belief.nis_dof
        error = belief.state - states[-1]
        nees += error @ np.linalg.solve(belief.covariance, error)
    for total, degrees in ((nees, 3 * runs), (nis, dof)):
        low, high = chi2.interval(1.0 - FALSE_ALARM, df=degrees)
        assert low < total < high


def test_impossible_packets_are_left_out_and_a_step_without_packets_only_predicts(world, packet):
    association = Association(world.setting("s1"), fakes=BOX)
    association.correct(0, [packet(0, "s1", [1e200])])
    belief = association.estimate(0)
    np.testing.assert_array_equal(belief.state, world.plant.initial_mean)
    assert belief.detections[0].alarm
    association.correct(1, [])
    np.testing.assert_allclose(association.estimate(1).state, world.plant.A @ world.plant.initial_mean)
    assert association.exchange(1, 0, []) is None


def test_a_box_without_volume_is_refused(world):
    with pytest.raises(ValueError, match="give 'low' below 'high'"):
        Association(world.setting("s1"), fakes=FakeBox(2.0, 1.0))
