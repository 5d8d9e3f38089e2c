"""Invariant zeros: inputs that move a linear system and leave its outputs quiet.

A finite zero ``z`` of (A, B, C) comes with a state ``x`` and an input ``u`` for which the Rosenbrock pencil
``[[A - z I, B], [C, 0]]`` maps (x, u) to zero: then ``u z^k`` moves the state from ``x`` along ``x z^k``, and
the output stays zero.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from channel.known_model import Matrix

_TOLERANCE = 1e-9


class InvariantZero(NamedTuple):
    """A zero ``z`` with its state ``x`` (n,) of norm 1 and its input ``u`` (p,), complex as ``z`` may be."""

    z: complex
    x: np.ndarray
    u: np.ndarray


def invariant_zeros(A: Matrix, B: Matrix, C: Matrix) -> list[InvariantZero]:
    """Return the finite invariant zeros, the largest modulus first, of conjugate ones that above the axis.

    They are the eigenvalues of ``A + B F`` on the largest subspace V of the kernel of C with ``A V`` in
    ``V + Im B`` (Basile, Marro 1969); unlike the pencil, that has no eigenvalues at infinity.
    Raises ValueError when V is reached by inputs that leave the outputs quiet, for then every number is a
    zero.
    """
    V = _kept_quiet(A, B, C)
    if not V.shape[1]:
        return []
    both = np.hstack((V, B))
    if np.linalg.matrix_rank(both, _TOLERANCE * np.linalg.norm(both, 2)) < both.shape[1]:
        raise ValueError(
            "some input moves the plant and no output, at any rate; name fewer inputs or more sensors"
        )
    solved = np.linalg.lstsq(both, A @ V, rcond=None)[0]
    motion, feed = solved[: V.shape[1]], -solved[V.shape[1] :]
    values, vectors = np.linalg.eig(motion)
    zeros = []
    for z, vector in zip(values, vectors.T, strict=True):
        if z.imag >= 0.0:
            x, u = V @ vector, feed @ vector
            turn = np.linalg.norm(x) * np.exp(1j * np.angle(x[np.argmax(np.abs(x))]))
            zeros.append(InvariantZero(complex(z), x / turn, u / turn))
    return sorted(zeros, key=lambda zero: (-round(abs(zero.z), 9), -zero.z.real))


def _kept_quiet(A: Matrix, B: Matrix, C: Matrix) -> Matrix:
    """Return an orthonormal basis (n, d) of the largest controlled invariant subspace in the kernel of C."""
    V = _kernel(C)
    while V.shape[1]:
        reached = np.hstack((V, B))
        outside: Matrix = np.eye(len(A)) - reached @ np.linalg.pinv(reached, rcond=_TOLERANCE)
        smaller: Matrix = V @ _kernel(outside @ A @ V, float(np.linalg.norm(A, 2)))
        if smaller.shape[1] == V.shape[1]:
            break
        V = smaller
    return V


def _kernel(matrix: Matrix, scale: float | None = None) -> Matrix:
    """Return an orthonormal basis of the kernel; singular values below 1e-9 of the scale count as zero."""
    _, values, rows = np.linalg.svd(matrix)
    least = _TOLERANCE * (scale if scale is not None else max(values, default=0.0))
    kernel: Matrix = rows[int(np.sum(values > least)) :].T
    return kernel
