import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nodes.estimators.gaussian_mixture import (
    Mixture,
    inverse_factors,
    joined,
    log_sum,
    merge,
    moments,
    survivors,
)


def random_mixture(rng, size, d, spread=1.0):
    roots = rng.normal(size=(size, d, d))
    covariances = roots @ roots.swapaxes(1, 2) + 0.1 * np.eye(d)
    means = spread * rng.normal(size=(size, d))
    return Mixture(np.log(rng.dirichlet(np.ones(size))), means, covariances)


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    size=st.integers(1, 30),
    d=st.integers(1, 5),
    threshold=st.sampled_from([0.0, 0.5, 3.0, 1e9]),
)
def test_merging_preserves_weight_mean_and_covariance_of_the_whole(seed, size, d, threshold):
    mixture = random_mixture(np.random.default_rng(seed), size, d)
    merged = merge(mixture, threshold)
    assert merged.size <= size
    assert threshold < 1e9 or merged.size == 1
    assert merged.log_total() == pytest.approx(mixture.log_total(), abs=1e-12)
    for before, after in zip(moments(mixture), moments(merged), strict=True):
        np.testing.assert_allclose(after, before, rtol=1e-10, atol=1e-10)
    assert np.linalg.eigvalsh(merged.covariances).min() > 0.0


def test_components_far_apart_stay_apart_and_close_ones_join():
    means = np.array([[0.0], [0.1], [10.0], [10.1]])
    mixture = Mixture(np.log([0.4, 0.3, 0.2, 0.1]), means, np.ones((4, 1, 1)))
    merged = merge(mixture, 3.0)
    np.testing.assert_allclose(np.exp(merged.log_weights), [0.7, 0.3])
    np.testing.assert_allclose(merged.means[:, 0], [0.3 / 7.0, 10.0 + 0.1 / 3.0])


def test_survivors_are_the_heaviest_first_and_never_none():
    weights = np.log([[0.5, 0.001], [0.3, 0.199]])
    assert survivors(weights, 0.01, 10).tolist() == [0, 2, 3]
    assert survivors(weights, 0.0, 2).tolist() == [0, 2]
    assert survivors(weights, 1.0, 10).tolist() == [0]
    assert survivors(np.full(3, -np.inf), 0.0, 10).tolist() == []
    assert survivors(np.array([-1e9, -np.inf]), 1e-3, 10).tolist() == [0]


def test_weights_far_below_the_range_of_floats_still_add_up():
    assert log_sum(np.array([-1e6, -1e6])) == pytest.approx(-1e6 + np.log(2.0))
    assert log_sum(np.zeros(0)) == log_sum(np.full(2, -np.inf)) == -np.inf


def test_a_singular_covariance_has_a_distance_that_excludes_its_null_directions():
    factor = inverse_factors(np.array([[[4.0, 0.0], [0.0, 0.0]]]))[0]
    assert np.linalg.norm(factor @ [2.0, 0.0]) == pytest.approx(1.0)
    assert np.linalg.norm(factor @ [0.0, 1e-3]) > 1e3


def test_the_moments_of_two_mixtures_joined_are_those_of_all_their_components():
    rng = np.random.default_rng(0)
    one, other = random_mixture(rng, 3, 2), random_mixture(rng, 2, 2)
    mean, covariance = moments(joined(one, other))
    weights = np.exp(np.concatenate((one.log_weights, other.log_weights))) / 2.0
    means = np.concatenate((one.means, other.means))
    np.testing.assert_allclose(mean, weights @ means)
    second = np.einsum("j,jab->ab", weights, np.concatenate((one.covariances, other.covariances)))
    second = second + np.einsum("j,ja,jb->ab", weights, means, means)
    np.testing.assert_allclose(covariance, second - np.outer(mean, mean))
