from fractions import Fraction

import numpy as np
import pytest
from scipy.stats import chi2

from nodes.estimators.resampling import SCHEMES, effective_sample_size

FALSE_ALARM = 1e-6
WEIGHTS = np.array([0.31, 0.02, 0.0, 0.17, 0.2, 0.25, 0.05])
all_schemes = pytest.mark.parametrize("scheme", SCHEMES)


class Scripted:
    """A generator whose one draw is given."""

    def __init__(self, draw):
        self.draw = draw

    def random(self):
        return self.draw


def test_systematic_resampling_is_unbiased_exactly():
    """Its copies are constant between a finite number of offsets: the expectation is a finite sum.

    With N = 8 and weights that are multiples of 1/64, they change at offsets that are multiples of 1/8.
    """
    weights = np.array([20, 1, 0, 11, 13, 16, 3, 0]) / 64
    expected = np.zeros(8)
    for cell in range(8):
        offset = float(Fraction(2 * cell + 1, 16))
        copies = np.bincount(SCHEMES["systematic"](weights, Scripted(offset)), minlength=8)
        expected += copies / 8
    np.testing.assert_array_equal(expected, 8 * weights)


@all_schemes
def test_the_mean_number_of_copies_is_the_weight_times_the_number(scheme):
    """Against the central limit, with the sample's own variance; seven means, each two-sided."""
    rng, draws, size = np.random.default_rng(5), 20_000, len(WEIGHTS)
    copies = np.array([np.bincount(SCHEMES[scheme](WEIGHTS, rng), minlength=size) for _ in range(draws)])
    error = copies.mean(axis=0) - size * WEIGHTS
    deviation = copies.std(axis=0) / np.sqrt(draws)
    random = deviation > 0.0
    assert np.all(error[~random] == pytest.approx(0.0, abs=1e-12))
    assert np.all(error[random] ** 2 < deviation[random] ** 2 * chi2.isf(FALSE_ALARM / size, df=1))


@all_schemes
def test_there_are_as_many_particles_as_before_and_none_of_weight_zero(scheme):
    rng = np.random.default_rng(0)
    for _ in range(200):
        chosen = SCHEMES[scheme](WEIGHTS, rng)
        assert len(chosen) == len(WEIGHTS)
        assert 2 not in chosen


@all_schemes
@pytest.mark.parametrize("size", [2, 3, 100])
def test_one_particle_with_all_the_weight_becomes_all_of_them(scheme, size):
    weights = np.zeros(size)
    weights[-1] = 1.0
    assert np.all(SCHEMES[scheme](weights, np.random.default_rng(0)) == size - 1)


@pytest.mark.parametrize("scheme", ["systematic", "residual"])
def test_particles_of_equal_weight_are_each_kept_once(scheme):
    chosen = SCHEMES[scheme](np.full(8, 0.125), np.random.default_rng(0))
    np.testing.assert_array_equal(chosen, np.arange(8))


@pytest.mark.parametrize("scheme", ["systematic", "residual"])
def test_no_particle_gets_fewer_copies_than_its_whole_expected_ones(scheme):
    rng, size = np.random.default_rng(1), 50
    for _ in range(100):
        weights = rng.dirichlet(np.full(size, 0.3))
        copies = np.bincount(SCHEMES[scheme](weights, rng), minlength=size)
        assert np.all(copies >= np.floor(size * weights - 1e-9))


def test_the_effective_sample_size_is_the_number_of_equal_weights():
    assert effective_sample_size(np.full(40, 1 / 40)) == pytest.approx(40.0)
    assert effective_sample_size(np.array([0.5, 0.5, 0.0])) == pytest.approx(2.0)
    assert effective_sample_size(np.array([1.0, 0.0])) == 1.0
