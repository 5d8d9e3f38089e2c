"""Small dense linear algebra that several methods share."""

from __future__ import annotations

import numpy as np

from nodes.contract import Matrix


def square_root(covariance: Matrix) -> Matrix:
    """Return a factor L (n, n) with ``L L' = covariance``; a semidefinite covariance is allowed."""
    values, vectors = np.linalg.eigh(covariance)
    return np.ascontiguousarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def symmetrise(matrix: Matrix) -> Matrix:
    """Return the symmetric part (n, n)."""
    return 0.5 * (matrix + matrix.T)


def matrix_exponential(matrix: Matrix) -> Matrix:
    """Return ``exp`` of a small matrix (n, n): scaling, a Taylor polynomial to rounding, squaring."""
    norm = float(np.abs(matrix).sum(axis=0).max(initial=0.0))
    halvings = max(0, int(np.ceil(np.log2(norm))) + 4) if norm > 0.0 else 0
    scaled = matrix / 2.0**halvings
    term = total = np.eye(len(matrix))
    for order in range(1, 14):
        term = term.dot(scaled) / order
        total = total + term
    for _ in range(halvings):
        total = total.dot(total)
    return total
