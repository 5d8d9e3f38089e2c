import numpy as np
import pytest

from nodes.estimators.attack_model import LinearMap, SmoothMap


def bent(states, signals):
    """A map with a curvature, of two states and one signal."""
    x, y, a = states[:, 0], states[:, 1], signals[:, 0]
    return np.stack((x * y + a, np.sin(x) + 0.5 * a * y), axis=1)


def law(size, d, seed=0, scale=0.3):
    rng = np.random.default_rng(seed)
    roots = scale * rng.normal(size=(size, d, d))
    return rng.normal(size=(size, d)), roots @ roots.swapaxes(1, 2) + 0.01 * np.eye(d)


@pytest.mark.parametrize("rule", ["ekf", "ukf"])
def test_on_a_linear_map_every_rule_is_exact(rule):
    rng = np.random.default_rng(1)
    A, G, noise = rng.normal(size=(3, 2)), rng.normal(size=(3, 1)), np.eye(3)
    exact = LinearMap(A, G, noise)
    smooth = SmoothMap(lambda x, a: x @ A.T + a @ G.T, noise, 1, rule)
    means, covariances = law(4, 3)
    for one, other in (
        (exact.joint(means, covariances), smooth.joint(means, covariances)),
        (
            exact.plain(means[:, :2], covariances[:, :2, :2]),
            smooth.plain(means[:, :2], covariances[:, :2, :2]),
        ),
    ):
        np.testing.assert_allclose(other.value, one.value, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(other.slope, np.broadcast_to(one.slope, other.slope.shape), atol=1e-9)
        if other.spread is not None:
            np.testing.assert_allclose(other.spread, 0.0, atol=1e-12)


def test_the_tangent_is_the_derivative():
    means, covariances = law(3, 3)
    found = SmoothMap(bent, np.eye(2), 1, "ekf").joint(means, covariances)
    for (x, y, a), slope in zip(means, found.slope, strict=True):
        np.testing.assert_allclose(slope, [[y, x, 1.0], [np.cos(x), 0.5 * a, 0.5 * y]], rtol=1e-8, atol=1e-8)


def test_sigma_points_see_the_moments_of_a_curved_map():
    """The mean of a quadratic is exact; value and joint covariance follow a million draws."""
    means, covariances = law(1, 3, scale=0.1)
    found = SmoothMap(bent, np.eye(2), 1, "ukf").joint(means, covariances)
    draws = np.random.default_rng(2).multivariate_normal(means[0], covariances[0], 400_000)
    values = bent(draws[:, :2], draws[:, 2:])
    assert found.value[0, 0] == pytest.approx(means[0, 0] * means[0, 1] + covariances[0, 0, 1] + means[0, 2])
    np.testing.assert_allclose(found.value[0], values.mean(axis=0), atol=5e-3)
    cross = found.slope[0] @ covariances[0]
    np.testing.assert_allclose(cross, np.cov(values.T, draws.T)[:2, 2:], atol=5e-3)
    whole = found.slope[0] @ covariances[0] @ found.slope[0].T + found.spread[0]
    np.testing.assert_allclose(whole, np.cov(values.T), atol=5e-3)
    assert np.linalg.eigvalsh(found.spread[0])[0] > -1e-12
