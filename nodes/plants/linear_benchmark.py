"""The benchmark of joint input and state estimation: five states under a signal of two components."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from bus.packets import Vector
from nodes.gaussian import Gaussian
from nodes.plants.linear import Linear

A = (
    (0.5, 2.0, 0.0, 0.0, 0.0),
    (0.0, 0.2, 1.0, 0.0, 1.0),
    (0.0, 0.0, 0.3, 0.0, 1.0),
    (0.0, 0.0, 0.0, 0.7, 1.0),
    (0.0, 0.0, 0.0, 0.0, 0.1),
)
G = ((1.0, 0.0), (0.0, 1.0), (0.0, 0.0), (0.0, 0.0), (0.0, 0.0))
Q = (
    (1e-4, 0.0, 0.0, 0.0, 0.0),
    (0.0, 1e-4, 0.5e-4, 0.0, 0.0),
    (0.0, 0.5e-4, 1e-4, 0.0, 0.0),
    (0.0, 0.0, 0.0, 1e-4, 0.0),
    (0.0, 0.0, 0.0, 0.0, 1e-4),
)
GROUPS: Mapping[str, Sequence[int]] = {"x1": [0], "x2": [1], "x3_to_x5": [2, 3, 4]}


class LinearBenchmark(Linear):
    """A linear plant of five states (no units) whose attack's signal enters the first two of them.

    It is the system of Yong, Zhu, Frazzoli 2015 with the signal of Forti et al. 2019, section VI A, and a
    group of the score for ``x1``, for ``x2``, and for the states that no attack reaches.

    Parameters
    ----------
    period_s
        Sampling period (s); the dynamics do not depend on it.
    process_noise
        Law of the noise of one step; that of the literature by default.
    initial
        What estimators are told of the state of step 0.
    truth
        The true state of step 0; None draws it from ``initial``.
    """

    def __init__(
        self,
        period_s: float,
        *,
        process_noise: Gaussian | None = None,
        initial: Gaussian | None = None,
        truth: list[float] | None = None,
    ) -> None:
        super().__init__(
            period_s,
            A=[list(row) for row in A],
            process_noise=process_noise or Gaussian(covariance=[list(row) for row in Q]),
            initial=initial or Gaussian(std=100.0, mean=[10.0, 10.0, 0.0, 0.0, 0.0]),
            state_groups={name: list(indices) for name, indices in GROUPS.items()},
            G=[list(row) for row in G],
        )
        if truth is not None and len(truth) != len(A):
            raise ValueError(f"truth has {len(truth)} entries; give {len(A)}")
        self._truth: Vector | None = None if truth is None else np.array(truth, dtype=np.float64)

    def initial_state(self, rng: np.random.Generator) -> Vector:
        """Return the state (5,) of step 0."""
        drawn = super().initial_state(rng)
        return drawn if self._truth is None else self._truth.copy()
