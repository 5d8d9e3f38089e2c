"""Where a filter has its estimate of an attack from: its own tracking, or the adversary's own word."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from bus.packets import Vector
from nodes.contract import Matrix


class AttackEstimate(Protocol):
    """The estimate of what an adversary adds to one sensor's measurement (m,), in the present step."""

    @property
    def value(self) -> Vector:
        """The estimate (m,)."""
        ...

    @property
    def variance(self) -> Vector:
        """Its error variance (m,), as far as the source knows."""
        ...

    def predict(self, told: Vector | None) -> None:
        """Move to the next step; ``told`` (m,) is the adversary's word, where the topology grants it."""
        ...

    def update(self, innovation: Vector, variance: Vector) -> None:
        """Take what a measurement that was judged attacked is off, with its variance without the attack's."""
        ...


class ConvergingBiasTracker:
    """A Kalman filter of ``(gamma, target)`` for each component of a bias that converges.

    ``gamma+ = pole gamma + (1 - pole) target`` (Sadeghzadeh-Nokhodberiz 2022, eq (4)) with a target that is
    constant; it begins at gamma = 0 in step 0. It is updated in the steps that a detector judged attacked.

    Parameters
    ----------
    size
        Number ``m`` of measured components.
    pole
        The share of the distance to the target that is left after a step.
    target_std
        Prior standard deviation of the target, around 0.
    wander_std
        Standard deviation of the noise that gamma and the target are allowed, each step.
    """

    def __init__(self, size: int, *, pole: float, target_std: float, wander_std: float) -> None:
        rest = 1.0 - pole
        self._move = np.array([[pole, rest], [0.0, 1.0]])
        self._spread = np.array(
            [[pole * pole, 2.0 * pole * rest, rest * rest], [0.0, pole, rest], [0.0, 0.0, 1.0]]
        )
        self._wander = wander_std**2 * np.array([[1.0], [0.0], [1.0]])
        self._mean: Matrix = np.zeros((2, size))
        self._covariance: Matrix = np.zeros((3, size))
        self._covariance[2] = target_std**2

    @property
    def value(self) -> Vector:
        """The estimate (m,) of gamma."""
        value: Vector = self._mean[0]
        return value

    @property
    def variance(self) -> Vector:
        """The error variance (m,) of gamma."""
        variance: Vector = self._covariance[0]
        return variance

    def predict(self, told: Vector | None) -> None:
        """Move gamma one step towards the target."""
        self._mean = self._move.dot(self._mean)
        self._covariance = self._spread.dot(self._covariance) + self._wander

    def update(self, innovation: Vector, variance: Vector) -> None:
        """Correct both by the innovation (m,) of a measurement of gamma with this variance (m,)."""
        own, joint, target = self._covariance
        gain = self._covariance[:2] / (own + variance)
        self._mean = self._mean + gain * (innovation - self._mean[0])
        self._covariance = np.array((own - gain[0] * own, joint - gain[0] * joint, target - gain[1] * joint))


class ToldAttack:
    """The adversary's own word, exact or with white noise; 0 while nothing is told.

    Parameters
    ----------
    size
        Number ``m`` of measured components.
    noise_std
        Standard deviation of the noise of each component.
    rng
        Draws the noise: once a step, whether it is used or not.
    """

    def __init__(self, size: int, *, noise_std: float, rng: np.random.Generator) -> None:
        self._noise_std = noise_std
        self._rng = rng
        self.value: Vector = np.zeros(size)
        self.variance: Vector = np.full(size, noise_std**2)

    def predict(self, told: Vector | None) -> None:
        """Take the word of this step."""
        value = np.zeros_like(self.value) if told is None else told
        if self._noise_std > 0.0:
            value = value + self._noise_std * self._rng.standard_normal(len(value))
        self.value = value

    def update(self, innovation: Vector, variance: Vector) -> None:
        """Learn nothing: it was told."""
