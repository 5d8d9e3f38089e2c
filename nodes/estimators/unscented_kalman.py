"""The unscented Kalman filter: means and covariances carried by a few chosen points."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from annotated_types import Gt

from bus.packets import Packet, Vector
from nodes.contract import Matrix, Setting
from nodes.estimators.linear_gaussian import cholesky
from nodes.estimators.nonlinear_gaussian import NonlinearKalman, block_diagonal
from nodes.lapack import dtrtrs


class UnscentedKalman(NonlinearKalman):
    """An unscented Kalman filter on the packets of its sensors, without neighbours.

    ``2n + 1`` points that have the mean and the covariance of the estimate pass through the model, and give
    the moments of what comes out; they are drawn anew from the prediction before a correction (Julier and
    Uhlmann 1997; scaled as by Wan and van der Merwe 2000). The defaults make the weights of the cubature
    filter, ``1 / 2n`` each and 0 for the middle: no covariance can become indefinite. For a linear model it
    is the Kalman filter, whatever the weights.

    Parameters
    ----------
    setting
        The node's models: a plant with a transition, and sensors with a measurement function. (Jacobians are
        asked for, as from every such model, and not used.)
    alpha
        Scale of the points: they lie ``alpha sqrt(n + kappa)`` standard deviations off the mean.
    kappa
        Added to the number ``n`` of components there.
    beta
        Added to the weight of the middle point in covariances; 2 suits normal laws with a small ``alpha``.

    Raises
    ------
    ValueError
        When the plant or a sensor is of another kind, a sensor's noise is singular, or ``kappa`` is not
        above ``-n``.
    """

    def __init__(
        self,
        setting: Setting,
        *,
        alpha: Annotated[float, Gt(0.0)] = 1.0,
        beta: float = 0.0,
        kappa: float = 0.0,
    ) -> None:
        super().__init__(setting)
        n = len(self._state)
        spread = alpha**2 * (n + kappa)
        if not spread > 0.0:
            raise ValueError(f"{setting.name}: kappa is {kappa}; give more than {-n}")
        self._scale = float(np.sqrt(spread))
        self._mean_weights: Vector = np.full(2 * n + 1, 0.5 / spread)
        self._mean_weights[0] = 1.0 - n / spread
        self._covariance_weights: Vector = self._mean_weights.copy()
        self._covariance_weights[0] += 1.0 - alpha**2 + beta

    def _points(self) -> Matrix:
        """Return the points (2n + 1, n) of the present mean and covariance."""
        arms = self._scale * cholesky(self._covariance).T
        return np.concatenate((self._state[None], self._state + arms, self._state - arms))

    def _predict(self) -> None:
        moved = self._plant.transition(self._points())
        self._state = self._mean_weights.dot(moved)
        deviations = moved - self._state
        half = 0.5 * (self._covariance_weights * deviations.T).dot(deviations)
        self._covariance = half + half.T + self._plant.Q

    def _update(self, packets: Sequence[Packet]) -> None:
        sensors = [self._sensors[packet.source] for packet in packets]
        points = self._points()
        measured = np.concatenate([sensor.measure(points) for sensor in sensors], axis=1)
        predicted = self._mean_weights.dot(measured)
        deviations = measured - predicted
        weighted = self._covariance_weights * deviations.T
        S = weighted.dot(deviations) + block_diagonal([sensor.R for sensor in sensors])
        innovation = np.concatenate([packet.values for packet in packets]) - predicted
        factor = cholesky(0.5 * (S + S.T))
        whitened = dtrtrs(factor, weighted.dot(points - self._state), lower=1)[0]
        residual = dtrtrs(factor, innovation, lower=1)[0]
        self._state = self._state + residual.dot(whitened)
        self._covariance = self._covariance - whitened.T.dot(whitened)
        self._nis, self._nis_dof = float(residual.dot(residual)), len(innovation)
