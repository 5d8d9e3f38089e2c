"""A flow meter at the outlet of a tank: a measurement that is not linear in the level."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from annotated_types import MinLen

from bus.packets import Vector
from nodes.contract import Matrix, Plant
from nodes.gaussian import Gaussian
from nodes.plants.quadruple_tank import QuadrupleTank
from nodes.sensors.gaussian_noise import GaussianNoise


class TankOutflow(GaussianNoise):
    """A sensor ``y_i = a_i sqrt(2 g max(h_i, 0)) + v`` of some tanks of a quadruple tank (cm^3/s).

    Parameters
    ----------
    plant
        The quadruple tank.
    tanks
        The numbers of the tanks, from 1 to 4, in the order of the measurement.
    noise
        Law of ``v`` (cm^3/s); its mean must be zero.

    Raises
    ------
    ValueError
        When the plant is another, there is no such tank, or the noise has another size.
    """

    def __init__(self, plant: Plant, *, tanks: Annotated[list[int], MinLen(1)], noise: Gaussian) -> None:
        if not isinstance(plant, QuadrupleTank):
            raise ValueError(f"{type(plant).__name__} has no tanks; use the plant 'quadruple_tank'")
        if not set(tanks) <= {1, 2, 3, 4}:
            raise ValueError(f"tanks is {tanks}; give numbers from 1 to 4")
        super().__init__(noise, len(tanks))
        self._plant = plant
        self._index = np.array(tanks) - 1

    def observe(self, step: int, state: Vector, rng: np.random.Generator, **entering: Vector) -> Vector:
        """Measure (m,) the true levels (4,)."""
        values: Vector = self.measure(state[None])[0] + self.draw(rng)
        return values

    def measure(self, states: Matrix, signals: Matrix | None = None) -> Matrix:
        """Return the outflows (N, m) for each of N levels (N, 4); no signal of an attack enters."""
        return np.ascontiguousarray(self._plant.outflows(states)[:, self._index])

    def jacobian(self, state: Vector) -> Matrix:
        """Return the derivative (m, 4) of the outflows at levels (4,)."""
        derivative: Matrix = np.diag(self._plant.outflow_slopes(state))[self._index]
        return derivative
