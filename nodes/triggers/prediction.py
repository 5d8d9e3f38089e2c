"""What is predicted of a sensor's next value by all who know what it has sent so far."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from bus.packets import Vector
from nodes.contract import Matrix, Sensor, Setting
from nodes.estimators.linear_gaussian import Dynamics, Measurement, SensorBank, cholesky, correct
from nodes.sensors.innovation import Innovation
from nodes.triggers.contract import Silence, TriggerSetting
from nodes.triggers.silence import learn


class Prediction(Protocol):
    """Says what the value of a step is expected to be."""

    def at(self, step: int) -> tuple[Vector, Matrix]:
        """Return the expected value (m,) and the lower Cholesky factor (m, m) of its covariance."""
        ...

    def note(self, step: int, values: Vector | None, silence: Silence) -> None:
        """Take what was sent (m,), or what the silence told."""
        ...


class CommonFilter:
    """The Kalman filter of one sensor's own packets and silences, which sender and receiver both can run.

    Raises ValueError when the plant or the sensor is not linear, or the plant has an input, which nobody
    tells the sensor.
    """

    def __init__(self, setting: TriggerSetting, sensor: Sensor) -> None:
        plant = setting.plant
        if getattr(plant, "B", np.zeros(0)).size:
            raise ValueError(
                f"{setting.name}: a trigger that predicts needs a plant without input, which nobody tells "
                "the sender; take send_on_delta"
            )
        own = Setting(setting.name, plant, {setting.name: sensor}, {}, setting.rng)
        self._dynamics = Dynamics(own)
        self._model: Measurement = SensorBank(own).models[setting.name]
        self._state = plant.initial_mean
        self._covariance = plant.initial_covariance
        self._step = 0

    def at(self, step: int) -> tuple[Vector, Matrix]:
        """Return ``C x^-`` and the factor of ``C P^- C' + R``."""
        while self._step < step:
            self._state = self._dynamics.A.dot(self._state)
            self._covariance = self._dynamics.propagate(self._covariance)
            self._step += 1
        C, R = self._model
        return C.dot(self._state), cholesky(C.dot(self._covariance).dot(C.T) + R)

    def note(self, step: int, values: Vector | None, silence: Silence) -> None:
        """Correct by what was sent (m,), or by what the silence told."""
        if values is None:
            self._state, self._covariance = learn(self._state, self._covariance, self._model, silence)
            return
        correction = correct(self._state, self._covariance, self._model, values)
        self._state, self._covariance = correction.state, correction.covariance


class WhiteInnovation:
    """A smart sensor sends innovations already: zero is expected, with a covariance known to all."""

    def __init__(self, sensor: Innovation) -> None:
        self._gains = sensor.filter_gains()
        self._step = -1

    def at(self, step: int) -> tuple[Vector, Matrix]:
        """Return zero, and the factor of the innovation's covariance."""
        while self._step < step:
            self._gain = self._gains.next()
            self._step += 1
        return np.zeros(len(self._gain.S)), self._gain.factor

    def note(self, step: int, values: Vector | None, silence: Silence) -> None:
        """Do nothing: innovations are white."""


def prediction_of(setting: TriggerSetting) -> Prediction:
    """Return the prediction of a sensor's values; raises ValueError where nobody could make one."""
    if setting.sensor is None:
        raise ValueError(
            f"{setting.name}: only a sensor's values are predicted here; "
            "an estimator takes send_on_delta, relative, periodic, or stochastic_innovation with 'loop: open'"
        )
    if isinstance(setting.sensor, Innovation):
        return WhiteInnovation(setting.sensor)
    return CommonFilter(setting, setting.sensor)
