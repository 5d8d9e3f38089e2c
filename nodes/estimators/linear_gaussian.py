"""What the estimators of linear Gaussian models share: the models themselves, prediction and correction.

``ndarray.dot`` stands where ``@`` would read as well: on matrices this small the operator costs several
times as much.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from bus.packets import Packet, Vector
from nodes.contract import LinearPlant, LinearSensor, Matrix, Setting
from nodes.estimators.arrivals import measurements
from nodes.lapack import dpotrf, dtrtrs


class Dynamics:
    """The prediction ``x^- = A x^+``, ``P^- = A P^+ A' + Q`` of a linear plant.

    Raises
    ------
    ValueError
        When the plant of the setting is not linear.
    """

    def __init__(self, setting: Setting) -> None:
        plant = setting.plant
        if not isinstance(plant, LinearPlant):
            raise ValueError(
                f"{setting.name}: plant {type(plant).__name__} is not linear; "
                "use a linear plant, or a method for non-linear ones"
            )
        self.A = np.ascontiguousarray(plant.A)
        self.Q = np.ascontiguousarray(plant.Q)
        self._half_A = 0.5 * self.A
        self._A_transposed = np.ascontiguousarray(self.A.T)

    def propagate(self, covariance: Matrix) -> Matrix:
        """Return ``A P A' + Q`` (n, n), exactly symmetric."""
        half: Matrix = self._half_A.dot(covariance).dot(self._A_transposed)
        return half + half.T + self.Q


class Measurement(NamedTuple):
    """The model (m, n), (m, m) of a measurement ``y = C x + v``, ``v ~ N(0, R)``."""

    C: Matrix
    R: Matrix


class SensorBank:
    """The linear sensors that an estimator listens to.

    Raises
    ------
    ValueError
        When a sensor is not linear, its noise covariance is singular, or it sends innovations.
    """

    def __init__(self, setting: Setting) -> None:
        self.models: dict[str, Measurement] = {}
        for name, sensor in setting.sensors.items():
            if not isinstance(sensor, LinearSensor):
                raise ValueError(
                    f"{setting.name}: sensor {name} ({type(sensor).__name__}) is not linear; "
                    "use a linear sensor, or a method for non-linear ones"
                )
            refuse_innovations(setting, name)
            if dpotrf(sensor.R)[1] != 0:
                raise ValueError(f"{setting.name}: sensor {name} has singular noise; give it a positive std")
            self.models[name] = Measurement(np.ascontiguousarray(sensor.C), np.ascontiguousarray(sensor.R))
        self._sizes = {name: len(model.C) for name, model in self.models.items()}
        self.stacked = lru_cache(maxsize=256)(self._stack)
        """The joint model of the sensors named, whose noises are independent."""

    def measurements(self, step: int, packets: Sequence[Packet]) -> Sequence[Packet]:
        """Return the packets that measure the state of ``step`` and fit their sensor's model."""
        return measurements(step, packets, self._sizes)

    def stack(self, packets: Sequence[Packet]) -> tuple[Measurement, Vector]:
        """Return the joint model and measurement of at least one packet, in the order of the packets."""
        if len(packets) == 1:
            return self.models[packets[0].source], packets[0].values
        model = self.stacked(tuple([packet.source for packet in packets]))
        return model, np.concatenate([packet.values for packet in packets])

    def _stack(self, sources: tuple[str, ...]) -> Measurement:
        """Return the joint model of sensors: one ``C`` over the other, ``R`` block by block."""
        models = [self.models[source] for source in sources]
        C = np.concatenate([model.C for model in models])
        R = np.zeros((len(C), len(C)))
        begin = 0
        for model in models:
            end = begin + len(model.R)
            R[begin:end, begin:end] = model.R
            begin = end
        return Measurement(C, R)


def refuse_innovations(setting: Setting, name: str) -> None:
    """Raise ValueError when a sensor sends innovations, which only one method can use."""
    if getattr(setting.sensors[name], "sends_innovations", False):
        raise ValueError(
            f"{setting.name}: sensor {name} sends innovations, not measurements; "
            "use the method innovation_kalman for it"
        )


class Correction(NamedTuple):
    """A linear minimum-variance correction, and what its detectors need.

    ``state`` (n,) and ``covariance`` (n, n) after it; ``innovation`` (m,) with the lower Cholesky
    ``factor`` L (m, m) of its covariance ``S = C P C' + R``; ``whitened`` (m, n) is ``L^-1 C P``; ``nis``
    is ``innovation' S^-1 innovation``.
    """

    state: Vector
    covariance: Matrix
    innovation: Vector
    factor: Matrix
    whitened: Matrix
    nis: float

    def gain(self) -> Matrix:
        """Return the gain ``K = P C' S^-1`` (n, m)."""
        gain: Matrix = dtrtrs(self.factor, self.whitened, lower=1, trans=1)[0].T
        return gain


def correct(state: Vector, covariance: Matrix, model: Measurement, values: Vector) -> Correction:
    """Return the Kalman correction of a state (n,) with covariance (n, n) by a measurement (m,)."""
    C, R = model
    innovation = values - C.dot(state)
    projected = C.dot(covariance)
    factor = cholesky(projected.dot(C.T) + R)
    whitened = dtrtrs(factor, projected, lower=1)[0]
    residual = dtrtrs(factor, innovation, lower=1)[0]
    return Correction(
        state + residual.dot(whitened),
        covariance - whitened.T.dot(whitened),
        innovation,
        factor,
        whitened,
        float(residual.dot(residual)),
    )


def cholesky(covariance: Matrix) -> Matrix:
    """Return the lower Cholesky factor (m, m) of an innovation covariance, or NaN where it has none.

    Since the noise covariance of each sensor is positive definite, only a filter that diverged comes to that.
    """
    factor: Matrix
    factor, info = dpotrf(covariance, lower=1)
    return factor if info == 0 else np.full_like(covariance, np.nan)


def mahalanobis_squared(innovation: Vector, factor: Matrix) -> float:
    """Return ``innovation' S^-1 innovation``, given the lower Cholesky factor (m, m) of ``S``."""
    residual = dtrtrs(factor, innovation, lower=1)[0]
    return float(residual.dot(residual))
