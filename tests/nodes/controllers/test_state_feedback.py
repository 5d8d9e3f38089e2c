import numpy as np
import pytest
from scipy.stats import chi2

from nodes.contract import ControllerSetting
from nodes.controllers.state_feedback import StateFeedback
from nodes.gaussian import Gaussian
from nodes.plants.linear import Linear

FALSE_ALARM = 1e-6


def setting(seed=0, B=((0.0, 1.0), (1.0, 0.0))):
    plant = Linear(
        1.0,
        A=[[1.0, 0.1], [0.0, 1.0]],
        B=None if B is None else [list(row) for row in B],
        process_noise=Gaussian(std=0.0),
        initial=Gaussian(std=0.0),
    )
    return ControllerSetting("c1", plant, np.random.default_rng(seed))


GAIN = [[1.0, 2.0], [0.0, 3.0]]


def test_it_feeds_the_estimate_back_with_the_gain_and_the_opposite_sign():
    controller = StateFeedback(setting(), gain=GAIN)
    np.testing.assert_array_equal(controller.control(0, np.array([1.0, 10.0])), [-21.0, -30.0])


def test_at_the_reference_it_asks_for_nothing():
    controller = StateFeedback(setting(), gain=GAIN, reference=[4.0, 5.0])
    np.testing.assert_array_equal(controller.control(0, np.array([4.0, 5.0])), [0.0, 0.0])
    np.testing.assert_array_equal(controller.control(1, np.array([3.0, 5.0])), [1.0, 0.0])


def test_without_an_estimate_it_asks_for_nothing():
    np.testing.assert_array_equal(StateFeedback(setting(), gain=GAIN).control(0, None), [0.0, 0.0])


def test_the_watermark_is_white_and_has_the_law_that_was_asked_for():
    covariance = [[0.2, 0.1], [0.1, 0.3]]
    watermark = Gaussian(covariance=covariance)
    controller = StateFeedback(setting(3), gain=GAIN, watermark=watermark)
    plain = StateFeedback(setting(3), gain=GAIN)
    draws, state = 4000, np.array([1.0, 2.0])
    added = np.array([controller.control(k, state) - plain.control(k, state) for k in range(draws)])
    white = np.linalg.solve(np.linalg.cholesky(np.array(covariance)), added.T)
    low, high = chi2.interval(1.0 - FALSE_ALARM, df=2 * draws)
    assert low < np.sum(white**2) < high
    lagged = np.sum(white[:, 1:] * white[:, :-1]) / np.sqrt(2 * draws)
    assert lagged**2 < chi2.isf(FALSE_ALARM, df=1)


def test_the_watermark_of_a_step_does_not_depend_on_which_estimates_there_were():
    one = StateFeedback(setting(4), gain=GAIN, watermark=Gaussian(std=1.0))
    other = StateFeedback(setting(4), gain=GAIN, watermark=Gaussian(std=1.0))
    one.control(0, None)
    other.control(0, np.array([7.0, 7.0]))
    np.testing.assert_array_equal(one.control(1, None), other.control(1, None))


@pytest.mark.parametrize(
    ("B", "parameters", "message"),
    [
        (None, {"gain": GAIN}, "c1: the plant has no input; give it a matrix B"),
        (
            ((1.0,), (0.0,)),
            {"gain": GAIN},
            r"the gain has rows of lengths \[2, 2\]; give 1 rows of 2 entries",
        ),
        (((1.0,), (0.0,)), {"gain": [[1.0]]}, r"give 1 rows of 2 entries"),
        (((1.0,), (0.0,)), {"gain": [[1.0, 2.0]], "reference": [1.0]}, "1 entries, expected 2"),
        (
            ((1.0,), (0.0,)),
            {"gain": [[1.0, 2.0]], "watermark": Gaussian(std=1.0, mean=[1.0])},
            "leave the mean out",
        ),
    ],
)
def test_parameters_that_do_not_fit_are_refused_with_the_cure(B, parameters, message):
    with pytest.raises(ValueError, match=message):
        StateFeedback(setting(B=B), **parameters)
