"""What silence tells: against quadrature, and against the law of simulated values."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import truncnorm

from nodes.estimators.linear_gaussian import Measurement
from nodes.triggers.contract import BoxSilence, GaussianSilence
from nodes.triggers.silence import box_moments, learn, truncated_moments


@pytest.mark.parametrize(
    ("low", "high"), [(-1.0, 1.0), (-0.3, 2.0), (1.0, 1.5), (3.0, 9.0), (-8.0, -2.0), (6.0, 7.0)]
)
def test_moments_of_a_truncated_law_are_those_of_scipy(low: float, high: float) -> None:
    mean, variance = truncated_moments(low, high)
    assert mean == pytest.approx(float(truncnorm.mean(low, high)), rel=1e-7)
    assert variance == pytest.approx(float(truncnorm.var(low, high)), rel=1e-6)


def test_bounds_far_out_in_a_tail_give_finite_moments_near_the_nearer_bound() -> None:
    for low, high in ((40.0, 41.0), (-90.0, -60.0)):
        mean, variance = truncated_moments(low, high)
        near = min(abs(low), abs(high))
        assert near < abs(mean) < near + 2.0 / near
        assert 0.0 < variance < 2.0 / near**2


def posterior_by_quadrature(likelihood: np.ndarray, grid: np.ndarray, prior: float) -> tuple[float, float]:
    """Return mean and variance of x on a grid, given its prior variance and the likelihood of silence."""
    weight = np.exp(-0.5 * grid**2 / prior) * likelihood
    weight /= weight.sum()
    mean = float(weight @ grid)
    return mean, float(weight @ (grid - mean) ** 2)


@pytest.mark.parametrize("centre", [0.0, 0.7])
def test_silence_gives_the_moments_that_quadrature_gives(centre: float) -> None:
    """One state, one output y = 2 x + v; the value is integrated out on a grid as well."""
    P, C, R, Y, half_width = 0.8, 2.0, 0.3, 1.7, 1.2
    grid, noise = np.linspace(-8.0, 8.0, 2001), np.linspace(-5.0, 5.0, 2001)
    density = np.exp(-0.5 * noise**2 / R)
    y = C * grid[:, None] + noise[None, :]
    model = Measurement(np.array([[C]]), np.array([[R]]))
    root = 1.3
    cases = [
        (GaussianSilence(np.array([centre]), np.array([[1.0 / Y]])), np.exp(-0.5 * Y * (y - centre) ** 2)),
        (
            BoxSilence(np.array([centre]), np.array([[root]]), half_width),
            abs(y - centre) <= root * half_width,
        ),
    ]
    for silence, quiet in cases:
        state, covariance = learn(np.zeros(1), np.array([[P]]), model, silence)
        mean, variance = posterior_by_quadrature(quiet @ density, grid, P)
        assert state[0] == pytest.approx(mean, abs=3e-3)
        assert covariance[0, 0] == pytest.approx(variance, rel=3e-3)


def test_several_uncorrelated_components_are_cut_exactly() -> None:
    mean, covariance = box_moments(np.array([0.4, -0.2]), np.diag([1.0, 2.0]), 0.9)
    for i, (at, scale) in enumerate(((0.4, 1.0), (-0.2, np.sqrt(2.0)))):
        low, high = (-0.9 - at) / scale, (0.9 - at) / scale
        assert mean[i] == pytest.approx(at + scale * float(truncnorm.mean(low, high)))
        assert covariance[i, i] == pytest.approx(scale**2 * float(truncnorm.var(low, high)))
    assert covariance[0, 1] == 0.0
