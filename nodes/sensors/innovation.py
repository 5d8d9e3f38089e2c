"""A smart sensor: it filters what it measures, and sends the innovations."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from bus.packets import Vector
from nodes.contract import LinearPlant, Matrix, Plant
from nodes.filter_gains import FilterGains, GainKind
from nodes.gaussian import Gaussian
from nodes.sensors.linear import Linear


class Innovation(Linear):
    """Measures ``y = C x + H a + v`` and sends ``z = y - C x^-``, the innovation of a filter of its own.

    The filter (Guo, Shi, Johansson, Shi 2017) is ``x^- = A x^+``, ``x^+ = x^- + K z``. Its
    innovations are white, with covariance ``S = C P^- C' + R``; an `InnovationKalman` makes estimates of
    them. It keeps a state, so one object observes one run, each step once and in order.

    Parameters
    ----------
    plant
        The plant that it measures: a linear one without inputs, which nobody would tell the sensor.
    C
        Measurement matrix (m, n): units of the measurement over units of the state.
    noise
        Law of ``v``, in units of the measurement; its mean must be zero, and none of it certain.
    H
        Matrix (m, q) by which an attack's signal enters the measurement.
    gains
        ``time_varying`` gains follow from the plant's initial law and are optimal from step 0 on; ``steady``
        ones are their limit.

    Raises
    ------
    ValueError
        When the plant is not linear or has an input, a shape does not fit, the noise is singular, or the
        gains have no limit.
    """

    sends_innovations: ClassVar[bool] = True

    def __init__(
        self,
        plant: Plant,
        *,
        C: list[list[float]],
        noise: Gaussian,
        H: list[list[float]] | None = None,
        gains: GainKind = "time_varying",
    ) -> None:
        super().__init__(plant, C=C, noise=noise, H=H)
        if not isinstance(plant, LinearPlant) or getattr(plant, "B", np.zeros(0)).size:
            raise ValueError("a sensor that filters needs a linear plant without input; take a linear sensor")
        self._plant = plant
        self._kind = gains
        self._gains = self.filter_gains()
        self._A: Matrix = plant.A
        self._predicted: Vector = plant.initial_mean

    def filter_gains(self) -> FilterGains:
        """Return the gains of its filter, from step 0 on."""
        plant = self._plant
        return FilterGains(plant.A, plant.Q, self.C, self.R, plant.initial_covariance, self._kind)

    def observe(
        self, step: int, state: Vector, rng: np.random.Generator, *, attack: Vector | None = None
    ) -> Vector:
        """Measure the true state (n,) of the next step; return the innovation (m,)."""
        innovation: Vector = super().observe(step, state, rng, attack=attack) - self.C.dot(self._predicted)
        corrected = self._predicted + self._gains.next().K.dot(innovation)
        self._predicted = self._A.dot(corrected)
        return innovation
