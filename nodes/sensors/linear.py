"""A linear sensor with white Gaussian noise."""

from __future__ import annotations

import numpy as np

from bus.packets import Vector
from nodes.contract import Matrix, Plant
from nodes.gaussian import Gaussian
from nodes.linear_algebra import square_root


class Linear:
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
        n = len(plant.initial_mean)
        if not C or any(len(row) != n for row in C):
            lengths = [len(row) for row in C]
            raise ValueError(f"C has rows of lengths {lengths}; give at least one row, each with {n} entries")
        if noise.mean is not None and any(noise.mean):
            raise ValueError("noise must have mean zero; leave the mean out, or use a bias attack for it")
        self.C: Matrix = np.array(C, dtype=np.float64)
        if H is not None and (len(H) != len(C) or len({len(row) for row in H}) > 1):
            raise ValueError(f"H has {len(H)} rows; give one for each of the {len(C)} measured outputs")
        self.H: Matrix | None = None if H is None else np.array(H, dtype=np.float64)
        self.R: Matrix = noise.covariance_matrix(len(C))
        self._noise_factor = square_root(self.R)

    def observe(
        self, step: int, state: Vector, rng: np.random.Generator, *, attack: Vector | None = None
    ) -> Vector:
        """Measure (m,) the true state (n,)."""
        values: Vector = self.C.dot(state) + self._noise_factor.dot(rng.standard_normal(len(self.C)))
        return values if attack is None or self.H is None else values + self.H.dot(attack)
