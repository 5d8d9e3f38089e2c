"""What plants with additive Gaussian noise share: the draws of the initial state and of the noise."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from bus.packets import Vector
from nodes.chunks import chunks
from nodes.contract import Matrix
from nodes.gaussian import Gaussian
from nodes.linear_algebra import square_root


class Additive(ABC):
    """A plant ``x+ = f(x) + w`` with ``w ~ N(0, Q)`` and ``x_0 ~ N(mean, covariance)``.

    Parameters
    ----------
    period_s
        Sampling period (s).
    process_noise
        Law of ``w`` (n,) for one period; its mean must be zero.
    initial_mean, initial_covariance
        Law of the state of step 0, (n,) and (n, n).

    Raises
    ------
    ValueError
        When the period is not positive, or the process noise has a mean or another size than the state.
    """

    def __init__(
        self, period_s: float, process_noise: Gaussian, initial_mean: Vector, initial_covariance: Matrix
    ) -> None:
        if not period_s > 0.0:
            raise ValueError(f"period_s is {period_s}; give a positive sampling period in seconds")
        if process_noise.mean is not None and any(process_noise.mean):
            raise ValueError("process_noise must have mean zero; leave the mean out")
        self.period_s = period_s
        self.Q: Matrix = process_noise.covariance_matrix(len(initial_mean))
        self.initial_mean: Vector = initial_mean
        self.initial_covariance: Matrix = initial_covariance
        self._noise_factor = square_root(self.Q)
        self._initial_factor = square_root(initial_covariance)

    @abstractmethod
    def transition(self, states: Matrix) -> Matrix:
        """Return ``f`` (N, n) of each of N states (N, n)."""

    def initial_state(self, rng: np.random.Generator) -> Vector:
        """Draw the state (n,) of step 0."""
        state: Vector = self.initial_mean + self._initial_factor.dot(
            rng.standard_normal(len(self.initial_mean))
        )
        return state

    def sample_initial(self, number: int, rng: np.random.Generator) -> Matrix:
        """Draw states (number, n) of step 0."""
        draws = rng.standard_normal((len(self.initial_mean), number))
        states: Matrix = (self._initial_factor.dot(draws) + self.initial_mean[:, None]).T
        return states

    def sample(self, states: Matrix, rng: np.random.Generator) -> Matrix:
        """Draw a successor (N, n) of each of N states (N, n)."""
        successors: Matrix = self.transition(states)
        by_component = successors.T
        for chunk in chunks(len(states)):
            piece = by_component[:, chunk]
            piece += self._noise_factor.dot(rng.standard_normal(piece.shape))
        return successors
