"""The extended Kalman filter: the Kalman filter of the model linearised at the estimate."""

from __future__ import annotations

from collections.abc import Sequence

from bus.packets import Packet
from nodes.estimators.linear_gaussian import correct
from nodes.estimators.nonlinear_gaussian import NonlinearKalman, linearise, propagate


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
        self._state, self._covariance = propagate(self._plant, self._state, self._covariance)

    def _update(self, packets: Sequence[Packet]) -> None:
        model, values = linearise(self._sensors, self._state, packets)
        correction = correct(self._state, self._covariance, model, values)
        self._state, self._covariance = correction.state, correction.covariance
        self._nis, self._nis_dof = correction.nis, len(values)
