"""Four water tanks that flow into one another, fed by two pumps (Johansson 2000)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np

from bus.packets import Vector
from nodes.chunks import chunks
from nodes.contract import Matrix
from nodes.gaussian import Gaussian
from nodes.plants.additive import Additive

GRAVITY = 981.0
"""Acceleration of gravity (cm/s^2)."""
AREAS = np.array([28.0, 32.0, 28.0, 32.0])
"""Cross-sections of the tanks (cm^2)."""
HOLES = np.array([0.071, 0.057, 0.071, 0.057])
"""Cross-sections of their outlets (cm^2)."""
_FLOW = HOLES * np.sqrt(2.0 * GRAVITY)
_PROCESS_NOISE = Gaussian(std=0.01)
_INITIAL = Gaussian(std=0.01)


@dataclass(frozen=True)
class Pumping:
    """How the pumps feed the tanks, and the voltages that keep them at the published levels.

    ``gains`` (cm^3/(V s)) of the two pumps; ``splits`` are the shares that go to the lower tanks 1 and 2;
    ``voltages`` (V).
    """

    gains: tuple[float, float]
    splits: tuple[float, float]
    voltages: tuple[float, float]


PHASES: Mapping[str, Pumping] = {
    "minimum": Pumping((3.33, 3.35), (0.7, 0.6), (3.0, 3.0)),
    "non_minimum": Pumping((3.14, 3.29), (0.43, 0.34), (3.15, 3.15)),
}
"""The two operating points of Johansson 2000, Table 1."""


class QuadrupleTank(Additive):
    """Levels (cm) of four tanks: 3 empties into 1 and 4 into 2; pump 1 feeds 1 and 4, pump 2 feeds 2 and 3.

    With outflows ``q_i = a_i sqrt(2 g max(h_i, 0))``, pump gains k, splits s and constant voltages v:
    ``h1' = (-q1 + q3 + s1 k1 v1) / A1``, ``h2' = (-q2 + q4 + s2 k2 v2) / A2``, ``h3' = (-q3 + (1 - s2) k2
    v2) / A3``, ``h4' = (-q4 + (1 - s1) k1 v1) / A4`` (Johansson 2000, eq (1)). One period is one step of the
    fourth-order Runge-Kutta method, and then noise is added. Groups of the score: ``lower`` (tanks 1 and 2)
    and ``upper`` (3 and 4).

    Parameters
    ----------
    period_s
        Sampling period (s); the slowest time constants are about 60 to 90 s, and the fastest 20 to 60 s.
    phase
        The operating point, named by the zeros of the linearised plant: ``minimum`` or ``non_minimum`` phase.
    voltages
        Constant pump voltages (V); those of the operating point when not given.
    process_noise
        Law of the noise that one period adds to the levels (cm); its mean must be zero.
    initial
        Law of the levels of step 0 (cm). Without a mean it is the equilibrium of the voltages.

    Raises
    ------
    ValueError
        When the period or a voltage is not positive, or a law does not have four components.
    """

    def __init__(
        self,
        period_s: float,
        *,
        phase: Literal["minimum", "non_minimum"] = "minimum",
        voltages: list[float] | None = None,
        process_noise: Gaussian = _PROCESS_NOISE,
        initial: Gaussian = _INITIAL,
    ) -> None:
        pumping = PHASES[phase]
        v = np.array(pumping.voltages if voltages is None else voltages, dtype=np.float64)
        if v.shape != (2,) or not np.all(v > 0.0):
            raise ValueError(f"voltages is {v.tolist()}; give two positive voltages, one for each pump")
        k, s = np.array(pumping.gains), np.array(pumping.splits)
        lower, upper = s * k * v, (1.0 - s) * k * v
        inflow = np.array([lower[0], lower[1], upper[1], upper[0]])
        through = inflow + np.array([inflow[2], inflow[3], 0.0, 0.0])
        self.equilibrium: Vector = (through / HOLES) ** 2 / (2.0 * GRAVITY)
        mean = self.equilibrium if initial.mean is None else initial.mean_vector(4)
        super().__init__(period_s, process_noise, mean, initial.covariance_matrix(4))
        self.state_groups: Mapping[str, Sequence[int]] = {"lower": [0, 1], "upper": [2, 3]}
        rate = inflow / AREAS
        self._half, self._half_constant = 0.5 * period_s * _flow_rates(), 0.5 * period_s * rate
        self._whole, self._whole_constant = period_s * _flow_rates(), period_s * rate
        half = np.column_stack((self._half, self._half_constant))
        whole = np.column_stack((self._whole, self._whole_constant))
        self._to_inside = (half, half, whole)
        self._to_end = np.column_stack((half, 2.0 * half, whole, half)) / 3.0
        self._scratch = lru_cache(maxsize=4)(_scratch)

    def transition(self, states: Matrix) -> Matrix:
        """Return the levels (N, 4) one period after each of N levels (N, 4), without noise."""
        levels = states.T
        moved = np.empty(levels.shape)
        for piece in chunks(len(states)):
            self._move(levels[:, piece], moved[:, piece])
        return moved.T

    def _move(self, levels: Matrix, moved: Matrix) -> None:
        """Write the levels (4, N) one period later; N is at most a chunk.

        A row of ones under the roots of each stage carries the constant inflow, so that a stage is one
        product, and so is the sum of all four. Memory that is asked for and given back in every call would
        cost more than the arithmetic.
        """
        stages, roots, inside = self._scratch(levels.shape[1])
        at = levels
        for matrix, (root, extended) in zip(self._to_inside, stages, strict=False):
            np.maximum(at, 0.0, out=root)
            np.sqrt(root, out=root)
            matrix.dot(extended, out=inside)
            inside += levels
            at = inside
        root = stages[3][0]
        np.maximum(at, 0.0, out=root)
        np.sqrt(root, out=root)
        np.add(levels, self._to_end.dot(roots), out=moved)

    def jacobian(self, state: Vector) -> Matrix:
        """Return the derivative (4, 4) of the transition at a state (4,), by the chain rule."""
        first = self._half.dot(_root(state)) + self._half_constant
        second = self._half.dot(_root(state + first)) + self._half_constant
        third = self._whole.dot(_root(state + second)) + self._whole_constant
        unit = np.eye(4)
        a = self._half * _root_slope(state)
        b = (self._half * _root_slope(state + first)).dot(unit + a)
        c = (self._whole * _root_slope(state + second)).dot(unit + b)
        d = (self._half * _root_slope(state + third)).dot(unit + c)
        derivative: Matrix = unit + (a + 2.0 * b + c + d) / 3.0
        return derivative

    def advance(self, step: int, state: Vector, rng: np.random.Generator, **entering: Vector) -> Vector:
        """Return the levels (4,) of ``step``, given those of the step before."""
        moved: Vector = self.transition(state[None])[0] + self._noise_factor.dot(rng.standard_normal(4))
        return moved

    def outflows(self, states: Matrix) -> Matrix:
        """Return the outflow (cm^3/s) of each tank, for levels (..., 4)."""
        flows: Matrix = _root(states) * _FLOW
        return flows

    def outflow_slopes(self, state: Vector) -> Vector:
        """Return the derivative (4,) of each tank's outflow by its level (cm^2/s); 0 for an empty tank."""
        slopes: Vector = _root_slope(state) * _FLOW
        return slopes


def _flow_rates() -> Matrix:
    """Return the matrix (4, 4) that makes the rates of change of the roots of the levels (4,)."""
    rates: Matrix = np.diag(-_FLOW / AREAS)
    rates[0, 2] = _FLOW[2] / AREAS[0]
    rates[1, 3] = _FLOW[3] / AREAS[1]
    return rates


def _scratch(size: int) -> tuple[list[tuple[Matrix, Matrix]], Matrix, Matrix]:
    """Return, for N = ``size``: for each of four stages, roots (4, N) and the same over a row of ones (5, N).

    Then all of them (20, N), of which the former are views, and room for levels (4, N).
    """
    roots = np.ones((4, 5, size))
    return [(stage[:4], stage) for stage in roots], roots.reshape(20, size), np.empty((4, size))


def _root(levels: Matrix | Vector) -> Matrix:
    """Return the square roots of levels, 0 below the bottom."""
    root: Matrix = np.sqrt(np.maximum(levels, 0.0))
    return root


def _root_slope(levels: Vector) -> Vector:
    """Return the derivative (4,) of the square roots by the levels, 0 below the bottom."""
    slope: Vector = np.divide(0.5, _root(levels), out=np.zeros(4), where=levels > 0.0)
    return slope
