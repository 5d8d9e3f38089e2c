"""Detectors of false data that count particles (Sadeghzadeh-Nokhodberiz et al. 2022, sections III and IV)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bus.packets import Vector
from nodes.chunks import chunks
from nodes.contract import LikelihoodSensor, LinearSensor, Matrix, NonlinearSensor


class Margin(NamedTuple):
    """What a correction leaves of an attack.

    ``gain`` K (n, m) is ``Q G' (R + G Q G')^-1`` (35), ``left`` (m, m) is ``I - G K``, and ``share`` the
    factor ``|sigma - 1|`` of Theorem 1, with ``sigma`` the singular value of ``G K`` nearest to 1.
    """

    gain: Matrix
    left: Matrix
    share: float


def margin(Q: Matrix, G: Matrix, R: Matrix) -> Margin:
    """Return the margin of a sensor with Jacobian ``G`` (m, n) and noise covariance ``R`` (m, m)."""
    gain: Matrix = np.linalg.solve(R + G.dot(Q).dot(G.T), G.dot(Q)).T
    kept = G.dot(gain)
    shares = np.abs(np.linalg.svd(kept, compute_uv=False) - 1.0)
    return Margin(gain, np.eye(len(G)) - kept, float(shares.min()))


class UpdatedParticles:
    """The modified detector: the share of updated particles whose residual is larger than a threshold.

    Each particle is drawn towards the measurement, ``x+ = x + K (y - g(x))`` (36), for this purpose alone,
    and all of them count alike (58). For a linear sensor ``y - G x+ = (I - G K) (y - G x)``.

    Parameters
    ----------
    sensor
        The sensor; it must have a Jacobian and a noise covariance.
    Q
        Covariance (n, n) of the process noise.
    state
        A state (n,) at which the gain is made, once and for all.
    minimum_attack
        Smallest norm of an attack that shall be detected; with the margin it makes the threshold (45).
    threshold
        The threshold ``eta`` itself, if not made of ``minimum_attack``.
    """

    def __init__(
        self,
        sensor: NonlinearSensor,
        Q: Matrix,
        state: Vector,
        *,
        minimum_attack: float,
        threshold: float | None,
    ) -> None:
        gain, self._left, share = margin(Q, sensor.jacobian(state), sensor.R)
        self._sensor = None if isinstance(sensor, LinearSensor) else sensor
        self._gain = gain
        self.threshold = share * minimum_attack if threshold is None else threshold
        self._square = self.threshold**2

    def statistic(self, values: Vector, states: Matrix, predicted: Matrix) -> float:
        """Return ``beta`` for a measurement (m,), given particles (N, n) and what they predict (N, m)."""
        outside = 0
        for chunk in chunks(len(predicted)):
            residuals = (values - predicted[chunk]).T
            if self._sensor is None:
                residuals = self._left.dot(residuals)
            else:
                updated = states[chunk] + self._gain.dot(residuals).T
                residuals = (values - self._sensor.measure(updated)).T
            residuals *= residuals
            outside += int(np.count_nonzero(residuals.sum(axis=0) > self._square))
        return outside / len(predicted)


class WeightedResiduals:
    """The detector of the normal filter: the probability, by likelihood, of a residual above a threshold.

    ``beta`` is the sum of ``p(y | x_i) / sum_j p(y | x_j)`` over the particles with ``|y - g(x_i)| > eta``
    (14), (17). The likelihoods are divided by the largest of them before they leave the logarithms: where
    all of them are too small for a double, their ratios are not.

    Parameters
    ----------
    sensor
        The sensor.
    threshold
        The threshold ``eta``.
    """

    def __init__(self, sensor: LikelihoodSensor, *, threshold: float) -> None:
        self._sensor = sensor
        self.threshold = threshold
        self._square = threshold**2

    def statistic(self, values: Vector, states: Matrix, predicted: Matrix) -> float:
        """Return ``beta`` for a measurement (m,), given particles (N, n) and what they predict (N, m)."""
        log_likelihood = self._sensor.log_likelihood(values, predicted)
        peak = log_likelihood.max()
        if peak == -np.inf:
            return 1.0
        weights = np.exp(log_likelihood - peak)
        residuals = values - predicted
        outside = (residuals * residuals).sum(axis=1) > self._square
        return float(weights[outside].sum() / weights.sum())
