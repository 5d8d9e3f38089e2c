"""A linear plant driven by white Gaussian noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from bus.packets import Vector
from nodes.contract import Matrix
from nodes.gaussian import Gaussian
from nodes.plants.additive import Additive


class Linear(Additive):
    """A plant ``x+ = A x + B u + G a + w`` with ``w ~ N(0, Q)`` and ``x_0 ~ N(mean, covariance)``.

    The input ``u`` (p,) comes from a controller, and ``a`` (q,) is an attack's signal; without ``B`` and
    ``G`` the plant has neither.

    Parameters
    ----------
    period_s
        Sampling period (s); ``A`` and ``process_noise`` already refer to one period.
    A
        Dynamics (n, n), unitless ratios of state components over one period.
    process_noise
        Law of ``w`` for one period, in state units; its mean must be zero.
    initial
        Law of the state of step 0, in state units.
    state_groups
        Names for parts of the state, each with the indices of its components. Without it the whole state is
        the one group ``state``.
    B
        Input matrix (n, p): change of the state over one period by a unit of input.
    G
        Matrix (n, q) by which an attack's signal enters the dynamics.
    holds_input
        What a lost input counts as: the one before (True), or zero.

    Raises
    ------
    ValueError
        When the period is not positive, a shape does not fit ``A``, the process noise has a mean, or a
        group names a component that the state does not have.
    """

    def __init__(
        self,
        period_s: float,
        *,
        A: list[list[float]],
        process_noise: Gaussian,
        initial: Gaussian,
        state_groups: dict[str, list[int]] | None = None,
        B: list[list[float]] | None = None,
        G: list[list[float]] | None = None,
        holds_input: bool = False,
    ) -> None:
        self.A: Matrix = _square_matrix(A)
        n = len(self.A)
        super().__init__(period_s, process_noise, initial.mean_vector(n), initial.covariance_matrix(n))
        self.state_groups: Mapping[str, Sequence[int]] = _checked_groups(state_groups, n)
        self.B: Matrix = _columns("B", B, n)
        self.G: Matrix = _columns("G", G, n)
        self.holds_input = holds_input

    def transition(self, states: Matrix) -> Matrix:
        """Return ``A x`` (N, n) of each of N states (N, n)."""
        moved: Matrix = self.A.dot(states.T).T
        return moved

    def jacobian(self, state: Vector) -> Matrix:
        """Return ``A`` (n, n)."""
        return self.A

    def advance(
        self,
        step: int,
        state: Vector,
        rng: np.random.Generator,
        *,
        control: Vector | None = None,
        attack: Vector | None = None,
    ) -> Vector:
        """Return the state (n,) of ``step``, given that of the step before, and what entered since."""
        moved: Vector = self.A.dot(state) + self._noise_factor.dot(rng.standard_normal(len(self.A)))
        if control is not None:
            moved = moved + self.B.dot(control)
        if attack is not None:
            moved = moved + self.G.dot(attack)
        return moved


def _square_matrix(rows: list[list[float]]) -> Matrix:
    """Return ``A`` (n, n); raises ValueError when the rows are ragged or too few."""
    if not rows or any(len(row) != len(rows) for row in rows):
        lengths = [len(row) for row in rows]
        raise ValueError(f"A has {len(rows)} rows of lengths {lengths}; give a square matrix, row by row")
    return np.array(rows, dtype=np.float64)


def _columns(name: str, rows: list[list[float]] | None, size: int) -> Matrix:
    """Return a matrix with a row for each state component, of no column when it is not given."""
    if rows is None:
        return np.zeros((size, 0))
    if len(rows) != size or len({len(row) for row in rows}) > 1 or not rows[0]:
        lengths = [len(row) for row in rows]
        raise ValueError(f"{name} has {len(rows)} rows of lengths {lengths}; give {size} rows of one length")
    return np.array(rows, dtype=np.float64)


def _checked_groups(groups: dict[str, list[int]] | None, size: int) -> dict[str, list[int]]:
    """Return the groups, or the one group of the whole state; raises ValueError on an index out of range."""
    if groups is None:
        return {"state": list(range(size))}
    for name, indices in groups.items():
        if not indices or not all(0 <= index < size for index in indices):
            raise ValueError(f"state_groups: {name!r} is {indices}; give indices from 0 to {size - 1}")
    return groups
