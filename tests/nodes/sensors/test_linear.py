import numpy as np
import pytest
from scipy.stats import chi2

from nodes.contract import LikelihoodSensor, LinearSensor, NonlinearSensor
from nodes.gaussian import Gaussian
from nodes.plants.constant_acceleration import ConstantAcceleration
from nodes.sensors.linear import Linear

PLANT = ConstantAcceleration(0.05, process_noise=Gaussian(std=0.2), initial=Gaussian(std=1.0))
FALSE_ALARM = 1e-6


def test_without_noise_it_measures_by_its_matrix_alone():
    sensor = Linear(PLANT, C=[[1.0, 0.0, 2.0], [0.0, 3.0, 0.0]], noise=Gaussian(std=0.0))
    for protocol in (LinearSensor, NonlinearSensor, LikelihoodSensor):
        assert isinstance(sensor, protocol)
    states, signals = np.array([[1.0, 2.0, 3.0]]), np.array([[0.5]])
    np.testing.assert_array_equal(sensor.measure(states), [[7.0, 6.0]])
    np.testing.assert_array_equal(sensor.measure(states, signals), [[7.0, 6.0]])
    entered = Linear(PLANT, C=sensor.C.tolist(), noise=Gaussian(std=0.0), H=[[2.0], [4.0]])
    np.testing.assert_array_equal(entered.measure(states, signals), [[8.0, 8.0]])
    values = sensor.observe(0, np.array([1.0, 2.0, 3.0]), np.random.default_rng(0))
    np.testing.assert_array_equal(values, [7.0, 6.0])


def test_its_noise_has_the_covariance_that_was_asked_for():
    covariance = [[0.2, 0.1], [0.1, 0.3]]
    sensor = Linear(PLANT, C=[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], noise=Gaussian(covariance=covariance))
    rng, draws = np.random.default_rng(2), 4000
    noise = np.array([sensor.observe(0, np.zeros(3), rng) for _ in range(draws)])
    white = np.linalg.solve(np.linalg.cholesky(sensor.R), noise.T)
    low, high = chi2.interval(1.0 - FALSE_ALARM, df=2 * draws)
    assert low < np.sum(white**2) < high
    assert draws * np.sum(white.mean(axis=1) ** 2) < chi2.isf(FALSE_ALARM, df=2)


@pytest.mark.parametrize(
    ("C", "noise", "message"),
    [
        ([[1.0, 0.0]], Gaussian(std=1.0), "each with 3 entries"),
        ([], Gaussian(std=1.0), "at least one row"),
        ([[1.0, 0.0, 0.0]], Gaussian(std=[1.0, 1.0]), "expected 1 or 1"),
        ([[1.0, 0.0, 0.0]], Gaussian(std=1.0, mean=[1.0]), "mean zero; leave the mean out, or use a bias"),
    ],
)
def test_parameters_that_do_not_fit_are_refused_with_the_cure(C, noise, message):
    with pytest.raises(ValueError, match=message):
        Linear(PLANT, C=C, noise=noise)
