import numpy as np
import pytest
from scipy.stats import binom
from scipy.stats import t as student_t

from nodes.contract import LikelihoodSensor, LinearSensor, NonlinearSensor
from nodes.plants.quadruple_tank import QuadrupleTank
from nodes.sensors.student_t import StudentT

PLANT = QuadrupleTank(1.0)
C = [[1.0, 0.0, 0.0, 0.0], [0.0, 2.0, 0.0, 0.0]]
FALSE_ALARM = 1e-6


def test_it_is_a_sensor_for_every_kind_of_filter():
    sensor = StudentT(PLANT, C=C, scale=0.1)
    for protocol in (LikelihoodSensor, NonlinearSensor, LinearSensor):
        assert isinstance(sensor, protocol)
    np.testing.assert_allclose(sensor.R, 0.03 * np.eye(2), rtol=1e-14)
    np.testing.assert_array_equal(sensor.jacobian(PLANT.initial_mean), C)


def test_its_likelihood_is_that_of_students_law():
    sensor = StudentT(PLANT, C=C, scale=[0.1, 0.3], degrees_of_freedom=4.0)
    predicted = np.array([[0.0, 0.0], [0.3, -2.0], [50.0, 0.0]])
    values = np.array([0.1, 0.2])
    exact = student_t.logpdf(values - predicted, 4.0, scale=[0.1, 0.3]).sum(axis=1)
    measured = sensor.log_likelihood(values, predicted)
    np.testing.assert_allclose(measured - measured[0], exact - exact[0], rtol=1e-12)


def test_its_tails_are_as_heavy_as_it_was_told():
    """The number of noises beyond four scales is binomial."""
    sensor, rng, draws = (
        StudentT(PLANT, C=C, scale=0.1, degrees_of_freedom=3.0),
        np.random.default_rng(3),
        4000,
    )
    state = PLANT.initial_mean
    noise = np.array([sensor.observe(0, state, rng) for _ in range(draws)]) - sensor.measure(state[None])
    low, high = binom.interval(1.0 - FALSE_ALARM, 2 * draws, 2.0 * student_t.sf(4.0, 3.0))
    assert low <= np.sum(np.abs(noise) > 0.4) <= high


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"scale": 0.0}, "one positive number, or 2"),
        ({"scale": [0.1]}, "one positive number, or 2"),
        ({"C": [[1.0]]}, "each with 4 entries"),
    ],
)
def test_parameters_that_do_not_fit_are_refused_with_the_cure(changes, message):
    with pytest.raises(ValueError, match=message):
        StudentT(PLANT, **{"C": C, "scale": 0.1, **changes})
