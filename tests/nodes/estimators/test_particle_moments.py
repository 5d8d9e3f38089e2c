from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.stats import chi2

from nodes.chunks import CHUNK, chunks
from nodes.estimators.kalman import Kalman
from nodes.estimators.particle import Particle
from nodes.estimators.particle_moments import moments, normalised_innovation_squared, stacked_noise

FALSE_ALARM = 1e-6


@pytest.mark.parametrize("number", [7, CHUNK, 2 * CHUNK + 5])
def test_the_moments_are_those_of_numpy_over_any_number_of_chunks(number):
    rng = np.random.default_rng(number)
    points, weights = rng.standard_normal((number, 3)), rng.dirichlet(np.ones(number))
    found = moments(weights, points)
    np.testing.assert_allclose(found.mean, np.average(points, axis=0, weights=weights), atol=1e-13)
    expected = np.cov(points.T, aweights=weights, ddof=0)
    np.testing.assert_allclose(found.covariance, expected, atol=1e-13)
    assert np.array_equal(found.covariance, found.covariance.T)


@pytest.mark.parametrize("size", [0, 1, CHUNK, CHUNK + 1, 3 * CHUNK])
def test_chunks_cut_everything_once(size):
    whole = np.arange(size)
    assert [entry for chunk in chunks(size) for entry in whole[chunk]] == list(range(size))
    assert all(chunk.stop - chunk.start <= CHUNK for chunk in chunks(size))


def test_noises_stand_in_blocks():
    noises = [np.array([[2.0]]), np.array([[3.0, 1.0], [1.0, 4.0]]), np.array([[5.0]])]
    assert np.array_equal(stacked_noise(noises), block_diag(*noises))


def test_an_innovation_beyond_all_doubles_has_the_greatest_number():
    predicted = moments(np.full(4, 0.25), np.zeros((4, 1)))
    with np.errstate(over="ignore"):
        found = normalised_innovation_squared(np.array([1e300]), predicted, np.eye(1))
    assert found == np.finfo(np.float64).max


def test_with_many_particles_the_nis_is_that_of_the_kalman_filter(world):
    own = replace(world.setting("s1", "s2"), rng=np.random.default_rng(3))
    kalman, particle = Kalman(own), Particle(own, particles=50_000)
    _, packets = world.trial(0, 6)
    for step in range(6):
        kalman.correct(step, packets[step])
        particle.correct(step, packets[step])
        expected, found = kalman.estimate(step), particle.estimate(step)
        assert found.nis_dof == expected.nis_dof > 0
        assert found.nis == pytest.approx(expected.nis, rel=0.1, abs=0.1)


def test_the_nis_of_independent_runs_is_chi_square(world):
    """Its sum over runs within the bounds of a false-alarm rate of 1e-6, with 3 % for a sample of 2000."""
    runs, total, dof = 60, 0.0, 0
    for seed in range(runs):
        own = Particle(
            replace(world.setting("s1", "s2"), rng=np.random.default_rng([seed, 9])), particles=2000
        )
        _, packets = world.trial(seed, 4)
        for step in range(4):
            own.correct(step, packets[step])
        belief = own.estimate(3)
        total, dof = total + belief.nis, dof + belief.nis_dof
    low, high = chi2.interval(1.0 - FALSE_ALARM, df=dof)
    assert 0.97 * low < total < 1.03 * high


def test_a_step_without_packets_and_a_sensor_of_unknown_noise_have_no_nis(world):
    class Unknown:
        def observe(self, step, state, rng):
            return state[:1]

        def measure(self, states):
            return states[:, :1]

        def log_likelihood(self, values, predicted):
            return -np.abs(values - predicted).sum(axis=1)

    own = replace(world.setting("s1"), rng=np.random.default_rng(0))
    particle = Particle(own, particles=50)
    particle.correct(0, [])
    assert (particle.estimate(0).nis, particle.estimate(0).nis_dof) == (0.0, 0)
    blind = Particle(replace(own, sensors={"s1": Unknown()}), particles=50)
    _, packets = world.trial(0, 1)
    blind.correct(0, [packet for packet in packets[0] if packet.source == "s1"])
    assert blind.estimate(0).nis_dof == 0
