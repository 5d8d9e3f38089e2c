"""The extended Kalman filter: the Kalman filter of the model linearised at the estimate."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bus.packets import Packet
from nodes.estimators.linear_gaussian import Measurement, correct
from nodes.estimators.nonlinear_gaussian import NonlinearKalman, block_diagonal


class ExtendedKalman(NonlinearKalman):
    """An extended Kalman filter on the packets of its sensors, without neighbours.

    The mean moves through the model itself, the covariance through the Jacobians: ``x^- = f(x^+)``, ``P^- =
    F P^+ F' + Q`` with ``F`` at ``x^+``, and the correction is Kalman's with ``C`` the Jacobian of the
    sensors at ``x^-`` and the innovation ``y - g(x^-)`` (Jazwinski 1970, section 8.3). For a linear model it
    is the Kalman filter.

    Parameters
    ----------
    setting
        The node's models: a plant with a transition and its Jacobian, and sensors with the same.

    Raises
    ------
    ValueError
        When the plant or a sensor is of another kind, or a sensor's noise is singular.
    """

    def _predict(self) -> None:
        F = self._plant.jacobian(self._state)
        half = 0.5 * F.dot(self._covariance).dot(F.T)
        self._state = self._plant.transition(self._state[None])[0]
        self._covariance = half + half.T + self._plant.Q

    def _update(self, packets: Sequence[Packet]) -> None:
        state = self._state
        sensors = [self._sensors[packet.source] for packet in packets]
        C = np.concatenate([sensor.jacobian(state) for sensor in sensors])
        predicted = np.concatenate([sensor.measure(state[None])[0] for sensor in sensors])
        values = np.concatenate([packet.values for packet in packets])
        model = Measurement(C, block_diagonal([sensor.R for sensor in sensors]))
        correction = correct(state, self._covariance, model, values - predicted + C.dot(state))
        self._state, self._covariance = correction.state, correction.covariance
        self._nis, self._nis_dof = correction.nis, len(values)
