"""Moments of weighted particles, and how well a measurement fits what they predict."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from bus.packets import Vector
from nodes.chunks import chunks
from nodes.contract import Matrix
from nodes.estimators.linear_gaussian import cholesky, mahalanobis_squared

_GREATEST = float(np.finfo(np.float64).max)


class Moments(NamedTuple):
    """The mean (n,) and the covariance (n, n) of weighted points."""

    mean: Vector
    covariance: Matrix


def moments(weights: Vector, points: Matrix) -> Moments:
    """Return the moments of points (N, n) with weights (N,) that sum to 1."""
    mean: Vector = weights.dot(points)
    scale = np.sqrt(weights)
    parts = []
    for chunk in chunks(len(points)):
        deviations = (points[chunk] - mean).T
        deviations *= scale[chunk]
        parts.append(deviations.dot(deviations.T))
    return Moments(mean, parts[0] if len(parts) == 1 else np.add.reduce(parts))


def stacked_noise(noises: Sequence[Matrix]) -> Matrix:
    """Return the block-diagonal covariance of independent noises."""
    if len(noises) == 1:
        return noises[0]
    size = sum(map(len, noises))
    whole: Matrix = np.zeros((size, size))
    begin = 0
    for noise in noises:
        end = begin + len(noise)
        whole[begin:end, begin:end] = noise
        begin = end
    return whole


def normalised_innovation_squared(values: Vector, predicted: Moments, noise: Matrix) -> float:
    """Return ``(y - mean)' (covariance + R)^-1 (y - mean)`` of a measurement (m,), or the greatest number.

    ``predicted`` holds the moments of what the particles predict, ``noise`` is ``R`` (m, m). With N particles
    the covariance is a sample's: for few of them the mean of this figure is larger than m.
    """
    factor = cholesky(predicted.covariance + noise)
    return min(mahalanobis_squared(values - predicted.mean, factor), _GREATEST)
