import numpy as np
import pytest

from nodes.estimators.likelihood_summary import (
    Summary,
    evaluate,
    packed,
    payload_size,
    summarise,
    terms,
    unpacked,
)
from nodes.gaussian import Gaussian
from nodes.plants.quadruple_tank import QuadrupleTank
from nodes.sensors.linear import Linear as LinearSensor
from nodes.sensors.student_t import StudentT
from nodes.sensors.tank_outflow import TankOutflow

PLANT = QuadrupleTank(1.0)
C = [[1.0, 0.0, 0.5, 0.0], [0.0, 2.0, 0.0, -1.0]]
STATES = PLANT.initial_mean + np.array([0.02, 0.02, 0.01, 0.03]) * np.random.default_rng(0).standard_normal(
    (400, 4)
)


def centred(values):
    return values - values.mean()


def test_of_a_linear_sensor_with_gaussian_noise_it_is_the_information_form_exactly():
    sensor = LinearSensor(PLANT, C=C, noise=Gaussian(std=[0.03, 0.1]))
    y = sensor.measure(PLANT.initial_mean[None])[0] + np.array([0.2, -0.1])
    found = summarise(STATES, sensor.log_likelihood(y, sensor.measure(STATES)))
    precise = np.linalg.solve(sensor.R, sensor.C)
    np.testing.assert_allclose(found.information, sensor.C.T @ precise, rtol=1e-7, atol=1e-5)
    np.testing.assert_allclose(
        found.gradient, precise.T @ (y - sensor.C @ found.centre), rtol=1e-7, atol=1e-6
    )


@pytest.mark.parametrize(
    ("sensor", "tolerance"),
    [
        (LinearSensor(PLANT, C=C, noise=Gaussian(std=0.03)), 1e-9),
        (TankOutflow(PLANT, tanks=[1, 3], noise=Gaussian(std=0.05)), 0.02),
        (StudentT(PLANT, C=C, scale=0.05, degrees_of_freedom=4.0), 0.3),
    ],
)
def test_it_says_of_other_states_what_the_likelihood_says(sensor, tolerance):
    """The share of the log-likelihood's spread that it gets wrong, at states that it was not fitted to."""
    y = sensor.measure(PLANT.initial_mean[None])[0] + 0.02
    found = summarise(STATES, sensor.log_likelihood(y, sensor.measure(STATES)))
    others = PLANT.initial_mean + 0.02 * np.random.default_rng(1).standard_normal((200, 4))
    expected = centred(sensor.log_likelihood(y, sensor.measure(others)))
    error = centred(evaluate(found, others)) - expected
    assert np.sqrt(np.mean(error**2)) < tolerance * np.sqrt(np.mean(expected**2))


def test_a_curvature_of_the_wrong_sign_is_taken_out():
    """Here of a function that is lowest where a density would be highest."""
    values = np.log1p(np.square(STATES[:, 0] - PLANT.initial_mean[0] - 0.001) * 1e4)
    found = summarise(STATES, values)
    assert np.linalg.eigvalsh(found.information)[0] >= -1e-9 * np.linalg.eigvalsh(found.information)[-1]
    assert found.information[0, 0] == pytest.approx(0.0, abs=1.0)


def test_states_that_do_not_spread_in_a_direction_tell_nothing_of_it():
    flat = STATES.copy()
    flat[:, 3] = PLANT.initial_mean[3]
    sensor = LinearSensor(PLANT, C=[[1.0, 0.0, 0.0, 1.0]], noise=Gaussian(std=0.03))
    found = summarise(flat, sensor.log_likelihood(np.array([13.7]), sensor.measure(flat)))
    assert np.isfinite(found.information).all()
    assert found.information[3, 3] == pytest.approx(0.0, abs=1e-6)
    assert found.information[0, 0] == pytest.approx(1.0 / 0.03**2, rel=1e-6)


def test_too_few_finite_likelihoods_make_no_summary():
    values = np.full(400, -np.inf)
    values[: terms(4) - 1] = -1.0
    assert summarise(STATES, values) is None
    values[: terms(4)] = -1.0
    assert summarise(STATES, values) is not None


def test_a_payload_holds_it_all():
    rng = np.random.default_rng(2)
    root = rng.standard_normal((4, 4))
    own = Summary(rng.standard_normal(4), rng.standard_normal(4), root @ root.T)
    assert packed(own).size == payload_size(4) == 18
    again = unpacked(packed(own), 4)
    for one, other in zip(own, again, strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_payload_of_another_size_or_curvature_is_none():
    own = Summary(np.zeros(2), np.zeros(2), np.diag([1.0, -0.1]))
    assert unpacked(packed(own), 2) is None
    assert unpacked(np.zeros(6), 2) is None
    assert unpacked(np.zeros(7), 2) is not None
