"""A robot on two wheels that drives in the plane with known inputs (Zhou, Zhang, Wang 2020)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Annotated

import numpy as np
from annotated_types import Gt

from bus.packets import Vector
from nodes.contract import Matrix
from nodes.gaussian import Gaussian
from nodes.plants.additive import Additive
from nodes.remainders import drawn_within, rotation_remainder

LAP = 30
"""Steps of one lap with the default turn."""
_PROCESS_NOISE = Gaussian(std=[0.01, 0.01, 0.005])
_INITIAL = Gaussian(std=0.1, mean=[1.5, 0.2, 0.0])


class PlanarRobot(Additive):
    """A position (m) and a heading (rad): ``x+ = x + s cos th``, ``y+ = y + s sin th``, ``th+ = th + turn``.

    With wheels that roll ``s_R`` and ``s_L`` in a step, ``b`` apart, ``s = (s_R + s_L) / 2`` and ``turn =
    (s_R - s_L) / b`` (Zhou, Zhang, Wang 2020, (36)-(38)). Both are the same in every step, and known:
    by default the robot drives one counter-clockwise lap of a radius of 0.96 m in 30 steps. The heading is
    not wrapped. Groups of the score: ``position`` (m) and ``heading`` (rad).

    Parameters
    ----------
    period_s
        Sampling period (s); the inputs are those of one step, so it only scales the time.
    forward
        ``s`` (m a step).
    turn
        ``turn`` (rad a step).
    process_noise
        Law of the noise of one step (m, m, rad); its mean must be zero.
    initial
        Law of the state of step 0 (m, m, rad).
    noise_bound
        Longest that process noise and initial deviation may be, in their own standard deviations (Mahalanobis
        length): a longer draw is shortened to it. Without it both are Gaussian. The covariances that filters
        are told are those of the Gaussian laws.

    Raises
    ------
    ValueError
        When the period is not positive, or a law does not have three components.
    """

    remainder_driver: Vector = np.array([0.0, 0.0, 1.0])
    """The part of the error that drives the remainder of a linearisation: that of the heading."""
    remainder_directions: Matrix = np.eye(3)[:, :2]
    """Where the remainder enters: the position."""

    def __init__(
        self,
        period_s: float,
        *,
        forward: float = 0.2,
        turn: float = 2.0 * math.pi / LAP,
        process_noise: Gaussian = _PROCESS_NOISE,
        initial: Gaussian = _INITIAL,
        noise_bound: Annotated[float, Gt(0.0)] | None = None,
    ) -> None:
        super().__init__(period_s, process_noise, initial.mean_vector(3), initial.covariance_matrix(3))
        self.state_groups: Mapping[str, Sequence[int]] = {"position": [0, 1], "heading": [2]}
        self.forward = forward
        self.turn = turn
        self._bound = math.inf if noise_bound is None else noise_bound

    def initial_state(self, rng: np.random.Generator) -> Vector:
        """Draw the state (3,) of step 0."""
        drawn: Vector = self.initial_mean + self._initial_factor.dot(drawn_within(self._bound, 3, rng))
        return drawn

    def transition(self, states: Matrix) -> Matrix:
        """Return the states (N, 3) one step after each of N states (N, 3), without noise."""
        heading = states[:, 2]
        moved = np.empty(states.shape)
        moved[:, 0] = states[:, 0] + self.forward * np.cos(heading)
        moved[:, 1] = states[:, 1] + self.forward * np.sin(heading)
        moved[:, 2] = heading + self.turn
        return moved

    def jacobian(self, state: Vector) -> Matrix:
        """Return the derivative (3, 3) of the transition at a state (3,)."""
        heading = float(state[2])
        derivative: Matrix = np.eye(3)
        derivative[0, 2] = -self.forward * math.sin(heading)
        derivative[1, 2] = self.forward * math.cos(heading)
        return derivative

    def remainder_bound(self, state: Vector, covariance: Matrix) -> float:
        """Return ``U`` with ``|f(x) - f(x^) - F e| <= U |e_th|`` for every e in an ellipsoid.

        The remainder has the two components of the position. The ellipsoid is ``e' P^-1 e <= 1``.
        """
        return abs(self.forward) * rotation_remainder(math.sqrt(max(covariance[2, 2], 0.0)))

    def advance(self, step: int, state: Vector, rng: np.random.Generator, **entering: Vector) -> Vector:
        """Return the state (3,) of ``step``, given that of the step before."""
        noise = self._noise_factor.dot(drawn_within(self._bound, 3, rng))
        moved: Vector = self.transition(state[None])[0] + noise
        return moved
