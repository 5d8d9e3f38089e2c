"""What sensors with additive Gaussian noise share: their draws and their likelihood."""

from __future__ import annotations

import numpy as np

from bus.packets import Vector
from nodes.chunks import chunks
from nodes.contract import Matrix
from nodes.gaussian import Gaussian
from nodes.linear_algebra import square_root


class GaussianNoise:
    """The noise ``v ~ N(0, R)`` of a measurement (m,), independent over steps and sensors.

    Parameters
    ----------
    noise
        The law; its mean must be zero.
    size
        Number ``m`` of measured components.

    Raises
    ------
    ValueError
        When the law has a mean, or another size.
    """

    def __init__(self, noise: Gaussian, size: int) -> None:
        if noise.mean is not None and any(noise.mean):
            raise ValueError("noise must have mean zero; leave the mean out, or use a bias attack for it")
        self.R: Matrix = noise.covariance_matrix(size)
        self._noise_factor = square_root(self.R)
        self._whitening = _whitening(self.R)

    def draw(self, rng: np.random.Generator) -> Vector:
        """Draw the noise (m,) of one measurement."""
        noise: Vector = self._noise_factor.dot(rng.standard_normal(len(self.R)))
        return noise

    def log_likelihood(self, values: Vector, predicted: Matrix) -> Vector:
        """Return the log density (N,) of a measurement (m,) around each of N others (N, m).

        The constant of the normal law is left out.

        Raises
        ------
        ValueError
            When the noise is singular: there is no density then.
        """
        if self._whitening is None:
            raise ValueError("a sensor with singular noise has no likelihood; give it a positive std")
        density: Vector = np.empty(len(predicted))
        for chunk in chunks(len(predicted)):
            white = self._whitening.dot((values - predicted[chunk]).T)
            white *= white
            white.sum(axis=0, out=density[chunk])
        density *= -0.5
        return density


def _whitening(covariance: Matrix) -> Matrix | None:
    """Return W (m, m) with ``W' W = R^-1``; None for a singular covariance."""
    try:
        factor = np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError:
        return None
    return np.linalg.inv(factor)
