"""A linear sensor with white Gaussian noise."""

from __future__ import annotations

import numpy as np

from bus.packets import Vector
from nodes.contract import Matrix, Plant
from nodes.gaussian import Gaussian
from nodes.sensors.gaussian_noise import GaussianNoise


class Linear(GaussianNoise):
    """A sensor ``y = C x + H a + v`` with ``v ~ N(0, R)``, independent over steps and sensors.

    ``a`` (q,) is the signal of an attack on the plant; without ``H`` it does not enter here.

    Parameters
    ----------
    plant
        The plant that it measures; only the size of its state is used.
    C
        Measurement matrix (m, n): units of the measurement over units of the state.
    noise
        Law of ``v``, in units of the measurement; its mean must be zero.
    H
        Matrix (m, q) by which an attack's signal enters the measurement.

    Raises
    ------
    ValueError
        When ``C`` does not have a column for each state component, ``noise`` not m components, or it has a
        mean.
    """

    def __init__(
        self, plant: Plant, *, C: list[list[float]], noise: Gaussian, H: list[list[float]] | None = None
    ) -> None:
        self.C: Matrix = measurement_matrix(C, plant)
        super().__init__(noise, len(C))
        if H is not None and (len(H) != len(C) or len({len(row) for row in H}) > 1):
            raise ValueError(f"H has {len(H)} rows; give one for each of the {len(C)} measured outputs")
        self.H: Matrix | None = None if H is None else np.array(H, dtype=np.float64)

    def observe(
        self, step: int, state: Vector, rng: np.random.Generator, *, attack: Vector | None = None
    ) -> Vector:
        """Measure (m,) the true state (n,)."""
        values: Vector = self.C.dot(state) + self.draw(rng)
        return values if attack is None or self.H is None else values + self.H.dot(attack)

    def measure(self, states: Matrix, signals: Matrix | None = None) -> Matrix:
        """Return ``C x + H a`` (N, m) of each of N states (N, n), and signals (N, q) if there are any."""
        predicted: Matrix = self.C.dot(states.T).T
        return predicted if signals is None or self.H is None else predicted + signals.dot(self.H.T)

    def jacobian(self, state: Vector) -> Matrix:
        """Return ``C`` (m, n)."""
        return self.C


def measurement_matrix(rows: list[list[float]], plant: Plant) -> Matrix:
    """Return ``C`` (m, n) of its rows; raises ValueError unless each has n entries."""
    n = len(plant.initial_mean)
    if not rows or any(len(row) != n for row in rows):
        lengths = [len(row) for row in rows]
        raise ValueError(f"C has rows of lengths {lengths}; give at least one row, each with {n} entries")
    return np.array(rows, dtype=np.float64)
