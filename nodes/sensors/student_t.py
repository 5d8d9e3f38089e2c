"""A linear sensor with heavy-tailed noise."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from annotated_types import Gt

from bus.packets import Vector
from nodes.contract import Matrix, Plant
from nodes.sensors.linear import measurement_matrix


class StudentT:
    """A sensor ``y = C x + scale t``, each component of ``t`` by Student's law, all independent.

    Its ``R`` is the covariance ``scale^2 nu / (nu - 2)``, so that Kalman-type filters can be given it: they
    are then the best *linear* ones, and an outlier moves them as far as any other value of its size.

    Parameters
    ----------
    plant
        The plant that it measures; only the size of its state is used.
    C
        Measurement matrix (m, n).
    scale
        Scale of the noise, in units of the measurement: one number, or one for each component.
    degrees_of_freedom
        The tail's exponent ``nu``, above 2: the smaller, the heavier.

    Raises
    ------
    ValueError
        When ``C`` does not have a column for each state component, or a scale is not positive.
    """

    def __init__(
        self,
        plant: Plant,
        *,
        C: list[list[float]],
        scale: float | list[float],
        degrees_of_freedom: Annotated[float, Gt(2.0)] = 3.0,
    ) -> None:
        self.C: Matrix = measurement_matrix(C, plant)
        scales = np.asarray(scale, dtype=np.float64)
        if scales.shape not in ((), (len(C),)) or not np.all(scales > 0.0):
            raise ValueError(f"scale is {scale}; give one positive number, or {len(C)}")
        self._scale: Vector = np.broadcast_to(scales, len(C)).copy()
        self._nu = degrees_of_freedom
        self.R: Matrix = np.diag(self._scale**2 * (self._nu / (self._nu - 2.0)))

    def observe(self, step: int, state: Vector, rng: np.random.Generator, **entering: Vector) -> Vector:
        """Measure (m,) the true state (n,)."""
        values: Vector = self.C.dot(state) + self._scale * rng.standard_t(self._nu, len(self.C))
        return values

    def measure(self, states: Matrix, signals: Matrix | None = None) -> Matrix:
        """Return ``C x`` (N, m) of each of N states (N, n); no signal of an attack enters."""
        predicted: Matrix = self.C.dot(states.T).T
        return predicted

    def jacobian(self, state: Vector) -> Matrix:
        """Return ``C`` (m, n)."""
        return self.C

    def log_likelihood(self, values: Vector, predicted: Matrix) -> Vector:
        """Return the log density (N,) of a measurement (m,) around each of N others, less a constant."""
        scaled = (values - predicted) / self._scale
        density: Vector = np.log1p(scaled * scaled / self._nu).sum(axis=1)
        density *= -0.5 * (self._nu + 1.0)
        return density
