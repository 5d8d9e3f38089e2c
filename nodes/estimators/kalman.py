"""The Kalman filter of one node: optimal for the measurements that arrive, if none is attacked."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Literal

from bus.packets import Packet, Vector
from nodes.contract import Belief, Setting
from nodes.estimators.linear_gaussian import Dynamics, SensorBank, correct


class Kalman:
    """A Kalman filter on the packets of the sensors that it listens to, without neighbours (Kalman 1960).

    The prior of step 0 is the plant's initial law; the measurements of step 0 already correct it. The
    packets of a step are taken jointly, and a step without packets only predicts. A packet sent in an
    earlier step is not used.

    Parameters
    ----------
    setting
        The node's models: a linear plant, and linear sensors whose noise is not singular.

    Raises
    ------
    ValueError
        When the plant or a sensor is not linear, or a sensor's noise is singular.
    """

    listens: ClassVar[Literal["paired", "all"]] = "paired"
    rounds: int = 0

    def __init__(self, setting: Setting) -> None:
        self._dynamics = Dynamics(setting)
        self._sensors = SensorBank(setting)
        self._state = setting.plant.initial_mean
        self._covariance = setting.plant.initial_covariance
        self._nis = 0.0
        self._nis_dof = 0

    def correct(self, step: int, packets: Sequence[Packet]) -> Vector | None:
        """Predict from the step before, then correct by this step's measurements; nothing is sent."""
        if step > 0:
            self._state = self._dynamics.A.dot(self._state)
            self._covariance = self._dynamics.propagate(self._covariance)
        self._nis, self._nis_dof = 0.0, 0
        current = self._sensors.measurements(step, packets)
        if current:
            model, values = self._sensors.stack(current)
            correction = correct(self._state, self._covariance, model, values)
            self._state, self._covariance = correction.state, correction.covariance
            self._nis, self._nis_dof = correction.nis, len(values)
        return None

    def exchange(self, step: int, round_: int, packets: Sequence[Packet]) -> Vector | None:
        """Do nothing: the filter works alone."""
        return None

    def estimate(self, step: int) -> Belief:
        """Return the filtered state and its error covariance."""
        return Belief(self._state, self._covariance, nis=self._nis, nis_dof=self._nis_dof)
