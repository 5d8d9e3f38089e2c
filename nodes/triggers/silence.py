"""What a receiver learns from a slot that stayed quiet."""

from __future__ import annotations

import math

import numpy as np

from bus.packets import Vector
from nodes.contract import Matrix
from nodes.estimators.linear_gaussian import Measurement, cholesky, correct
from nodes.lapack import dtrtrs
from nodes.triggers.contract import GaussianSilence, Silence


def learn(state: Vector, covariance: Matrix, model: Measurement, silence: Silence) -> tuple[Vector, Matrix]:
    """Return the state (n,) and covariance (n, n) given that the value ``y = C x + v`` was not sent.

    For a Gaussian silence it is exact: with Gaussian noise, silence is a measurement of the value ``c`` with
    noise covariance ``R + Y^-1`` (Han, Mo, Wu, Weerakkody, Sinopoli, Shi 2015, theorems 1 and 2, where c is 0
    or the prediction). For a box it is the Gaussian of the same mean and covariance (Wu, Jia, Johansson, Shi
    2013, whose box is centred at the prediction); with several outputs that is exact where their predictions
    are uncorrelated after whitening, as they are in the sender's own filter.
    """
    if isinstance(silence, GaussianSilence):
        noisier = Measurement(model.C, model.R + silence.covariance)
        correction = correct(state, covariance, noisier, silence.centre)
        return correction.state, correction.covariance
    C, R = model
    whitened = dtrtrs(silence.factor, C, lower=1)[0]
    root = dtrtrs(silence.factor, cholesky(R), lower=1)[0]
    cross = whitened.dot(covariance)
    spread = cross.dot(whitened.T) + root.dot(root.T)
    mean = dtrtrs(silence.factor, C.dot(state) - silence.centre, lower=1)[0]
    inside, within = box_moments(mean, spread, silence.half_width)
    factor = cholesky(spread)
    gain = dtrtrs(factor, dtrtrs(factor, cross, lower=1)[0], lower=1, trans=1)[0].T
    lost = gain.dot(spread - within).dot(gain.T)
    return state + gain.dot(inside - mean), covariance - 0.5 * (lost + lost.T)


def box_moments(mean: Vector, covariance: Matrix, half_width: float) -> tuple[Vector, Matrix]:
    """Return mean (m,) and covariance (m, m) of a Gaussian within ``[-half_width, half_width]^m``.

    Components are cut one after the other and the whole matched by a Gaussian each time: exact for one
    component and for uncorrelated ones.
    """
    mean, covariance = mean.copy(), covariance.copy()
    for i in range(len(mean)):
        variance = float(covariance[i, i])
        scale = math.sqrt(variance)
        at, left = truncated_moments((-half_width - mean[i]) / scale, (half_width - mean[i]) / scale)
        column = covariance[:, i] / variance
        mean += column * (scale * at)
        covariance -= np.outer(column, column) * (variance * (1.0 - left))
    return mean, covariance


def truncated_moments(low: float, high: float) -> tuple[float, float]:
    """Return mean and variance of a standard Gaussian between two bounds.

    Bounds so far out that no mass is left between them in double precision give the limit: an exponential
    law that leaves the nearer bound.
    """
    if low > 0.0:
        mean, variance = truncated_moments(-high, -low)
        return -mean, variance
    mass = 0.5 * (math.erf(high / math.sqrt(2.0)) - math.erf(low / math.sqrt(2.0)))
    if high < 0.0:
        mass = 0.5 * (math.erfc(-high / math.sqrt(2.0)) - math.erfc(-low / math.sqrt(2.0)))
    if mass < 1e-250:
        return high + 1.0 / high, 1.0 / high**2
    at_low, at_high = _density(low), _density(high)
    mean = (at_low - at_high) / mass
    variance = 1.0 + (low * at_low - high * at_high) / mass - mean * mean
    return mean, min(max(variance, 0.0), 1.0)


def _density(at: float) -> float:
    return math.exp(-0.5 * at * at) / math.sqrt(2.0 * math.pi)
