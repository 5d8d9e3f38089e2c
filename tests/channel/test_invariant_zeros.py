from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import eigvals

from channel.invariant_zeros import InvariantZero, invariant_zeros

PERIOD = 0.1
TRIPLE = (
    np.array([[1.0, PERIOD, PERIOD**2 / 2], [0.0, 1.0, PERIOD], [0.0, 0.0, 1.0]]),
    np.array([[PERIOD**3 / 6], [PERIOD**2 / 2], [PERIOD]]),
    np.array([[1.0, 0.0, 0.0]]),
)


def assert_solves_the_pencil(zero: InvariantZero, A: np.ndarray, B: np.ndarray, C: np.ndarray) -> None:
    np.testing.assert_allclose(A @ zero.x + B @ zero.u, zero.z * zero.x, atol=1e-9)
    np.testing.assert_allclose(C @ zero.x, 0.0, atol=1e-9)
    assert np.linalg.norm(zero.x) == pytest.approx(1.0)


def finite_eigenvalues_of_the_pencil(A: np.ndarray, B: np.ndarray, C: np.ndarray) -> np.ndarray:
    n, p = B.shape
    pencil = np.block([[A, B], [C, np.zeros((len(C), p))]])
    mass = np.zeros_like(pencil)
    mass[:n, :n] = np.eye(n)
    found = eigvals(pencil, mass)
    return found[np.isfinite(found) & (np.abs(found) < 1e5)]


def test_the_sampled_triple_integrator_has_the_zeros_of_the_textbook() -> None:
    """They are those of z^2 + 4 z + 1, whatever the period (Astrom, Hagander, Sternby 1984)."""
    zeros = invariant_zeros(*TRIPLE)
    assert [zero.z.real for zero in zeros] == pytest.approx([-2 - np.sqrt(3), -2 + np.sqrt(3)])
    for zero in zeros:
        assert_solves_the_pencil(zero, *TRIPLE)


@pytest.mark.parametrize("seed", range(20))
def test_zeros_of_a_square_system_are_the_finite_eigenvalues_of_the_rosenbrock_pencil(seed: int) -> None:
    rng = np.random.default_rng(seed)
    A, B, C = rng.standard_normal((5, 5)), rng.standard_normal((5, 2)), rng.standard_normal((2, 5))
    zeros = invariant_zeros(A, B, C)
    expected = finite_eigenvalues_of_the_pencil(A, B, C)
    above = sorted(expected[expected.imag > -1e-9], key=lambda z: (-round(abs(z), 9), -z.real))
    np.testing.assert_allclose([zero.z for zero in zeros], above, rtol=1e-6, atol=1e-6)
    for zero in zeros:
        assert_solves_the_pencil(zero, A, B, C)


def test_more_outputs_than_inputs_leave_only_the_zeros_that_all_of_them_share() -> None:
    A, B, C = TRIPLE
    assert invariant_zeros(A, B, np.eye(3)) == []
    twice = np.concatenate([C, 2.0 * C])
    assert [zero.z for zero in invariant_zeros(A, B, twice)] == pytest.approx(
        [zero.z for zero in invariant_zeros(A, B, C)]
    )


def test_a_system_whose_output_shows_every_input_at_once_and_every_state_has_none() -> None:
    assert invariant_zeros(np.array([[0.5]]), np.array([[1.0]]), np.array([[1.0]])) == []


def test_an_input_that_no_output_ever_shows_is_refused() -> None:
    A, B, C = np.diag([0.5, 0.9]), np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]])
    with pytest.raises(ValueError, match="name fewer inputs or more sensors"):
        invariant_zeros(A, B, C)
