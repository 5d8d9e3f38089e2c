import numpy as np
import pytest
from scipy.stats import multivariate_normal

from nodes.contract import LikelihoodSensor, LinearSensor, NonlinearSensor
from nodes.gaussian import Gaussian
from nodes.plants.constant_acceleration import ConstantAcceleration
from nodes.plants.quadruple_tank import QuadrupleTank
from nodes.sensors.tank_outflow import TankOutflow

PLANT = QuadrupleTank(1.0)
STATE = np.array([12.0, 13.0, 1.6, 1.4])


def test_it_measures_the_flow_through_the_outlet():
    sensor = TankOutflow(PLANT, tanks=[3, 1], noise=Gaussian(std=0.0))
    values = sensor.observe(0, STATE, np.random.default_rng(0))
    np.testing.assert_allclose(values, 0.071 * np.sqrt(2.0 * 981.0 * STATE[[2, 0]]), rtol=1e-14)


def test_at_rest_what_leaves_the_lower_tanks_is_what_the_pumps_give():
    flows = PLANT.outflows(PLANT.initial_mean)
    assert flows[:2].sum() == pytest.approx(3.0 * (3.33 + 3.35), rel=1e-12)


def test_its_jacobian_is_the_derivative_of_what_it_measures():
    sensor, h = TankOutflow(PLANT, tanks=[2, 4, 1], noise=Gaussian(std=0.1)), 1e-5
    steps = h * np.eye(4)
    numeric = (sensor.measure(STATE + steps) - sensor.measure(STATE - steps)).T / (2.0 * h)
    np.testing.assert_allclose(sensor.jacobian(STATE), numeric, atol=1e-8)


def test_it_is_a_sensor_for_filters_of_nonlinear_models_only():
    sensor = TankOutflow(PLANT, tanks=[1], noise=Gaussian(std=0.1))
    assert isinstance(sensor, LikelihoodSensor)
    assert isinstance(sensor, NonlinearSensor)
    assert not isinstance(sensor, LinearSensor)


def test_its_likelihood_is_that_of_the_normal_law():
    covariance = [[0.2, 0.1], [0.1, 0.3]]
    sensor = TankOutflow(PLANT, tanks=[1, 2], noise=Gaussian(covariance=covariance))
    predicted, values = np.array([[0.0, 0.0], [1.0, -2.0]]), np.array([0.3, 0.4])
    exact = [multivariate_normal.logpdf(values, row, covariance) for row in predicted]
    measured = sensor.log_likelihood(values, predicted)
    np.testing.assert_allclose(np.diff(measured), np.diff(exact), rtol=1e-12)


def test_without_noise_it_has_no_likelihood():
    sensor = TankOutflow(PLANT, tanks=[1], noise=Gaussian(std=0.0))
    with pytest.raises(ValueError, match="give it a positive std"):
        sensor.log_likelihood(np.zeros(1), np.zeros((2, 1)))


def test_what_it_cannot_measure_is_refused():
    with pytest.raises(ValueError, match="numbers from 1 to 4"):
        TankOutflow(PLANT, tanks=[0], noise=Gaussian(std=0.1))
    other = ConstantAcceleration(1.0, process_noise=Gaussian(std=0.2), initial=Gaussian(std=1.0))
    with pytest.raises(ValueError, match="use the plant 'quadruple_tank'"):
        TankOutflow(other, tanks=[1], noise=Gaussian(std=0.1))
