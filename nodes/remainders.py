"""Bounds that hold for certain: what a linearisation leaves out, and noise that is never too long."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from bus.packets import Vector
from nodes.contract import Matrix, NonlinearSensor

LARGEST_ROTATION_REMAINDER = 0.5 * (1.0 + math.sqrt(5.0))
"""The limit of `rotation_remainder`: where ``min(a^2 / 2, 2 + |a|)`` changes from one to the other."""


def rotation_remainder(angle: float) -> float:
    """Return c with ``|R(a) - I - J a| <= c |a|`` for all ``|a|`` up to an angle (rad).

    ``R`` is the rotation of the plane and ``J`` its derivative at zero. The left side is at most ``min(a^2 /
    2, 2 + |a|)``.
    """
    return min(0.5 * angle, LARGEST_ROTATION_REMAINDER)


def drawn_within(bound: float, size: int, rng: np.random.Generator) -> Vector:
    """Draw a standard normal vector (size,); one that is longer than the bound is shortened to it."""
    drawn: Vector = rng.standard_normal(size)
    if bound < math.inf:
        length = math.sqrt(drawn.dot(drawn))
        if length > bound:
            drawn *= bound / length
    return drawn


@runtime_checkable
class BoundedPlant(Protocol):
    """A plant whose linearisation has a known error.

    ``f(x) - f(x^) = F e + B a`` with ``|a| <= U |d' e|``: ``remainder_directions`` is ``B`` (n, q),
    ``remainder_driver`` is ``d`` (n,), ``U`` comes from `remainder_bound`.
    """

    remainder_directions: Matrix
    remainder_driver: Vector

    def remainder_bound(self, state: Vector, covariance: Matrix) -> float:
        """Return ``U`` around an estimate (n,), for errors in the ellipsoid ``e' P^-1 e <= 1``."""
        ...


@runtime_checkable
class BoundedSensor(Protocol):
    """A sensor with ``h(x) - h(x^) = H e + b`` and ``|b| <= V |d' e|``, ``d`` being that of the plant."""

    def remainder_bound(self, state: Vector, covariance: Matrix) -> float:
        """Return ``V`` around an estimate (n,), for errors in the ellipsoid ``e' P^-1 e <= 1``."""
        ...


class Linearised(NamedTuple):
    """M sensors, each linearised at an estimate of its own.

    ``values`` (M, m) are ``h``, ``slopes`` (M, m, n) are ``H``, and ``remainders`` (M,) are ``V``.
    """

    values: Matrix
    slopes: np.ndarray
    remainders: Vector


class Bank(Protocol):
    """Several sensors that are linearised at once."""

    def linearised(self, which: tuple[int, ...], states: Matrix, covariances: np.ndarray) -> Linearised:
        """Linearise some of the sensors, each at its estimate (M, n) with covariance (M, n, n)."""
        ...


class SensorBank:
    """Sensors of any kind, one after the other. One that has no bound on its remainder is taken as linear."""

    def __init__(self, sensors: Sequence[NonlinearSensor]) -> None:
        self._sensors = list(sensors)

    def linearised(self, which: tuple[int, ...], states: Matrix, covariances: np.ndarray) -> Linearised:
        """Linearise some of the sensors, each at its estimate (M, n) with covariance (M, n, n)."""
        places = list(zip((self._sensors[i] for i in which), states, covariances, strict=True))
        return Linearised(
            np.array([sensor.measure(state[None])[0] for sensor, state, _ in places]),
            np.array([sensor.jacobian(state) for sensor, state, _ in places]),
            np.array(
                [
                    sensor.remainder_bound(state, covariance) if isinstance(sensor, BoundedSensor) else 0.0
                    for sensor, state, covariance in places
                ]
            ),
        )


def bank_of(sensors: Sequence[NonlinearSensor]) -> Bank:
    """Return the bank of sensors: their kind's own ``bank`` when they are of one kind that has one."""
    kinds = {type(sensor) for sensor in sensors}
    make: Any = getattr(next(iter(kinds)), "bank", None) if len(kinds) == 1 else None
    bank: Bank = SensorBank(sensors) if make is None else make(sensors)
    return bank
