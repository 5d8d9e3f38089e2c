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
