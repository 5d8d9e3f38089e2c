"""What the triggers that compare values share."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bus.packets import Vector
from nodes.contract import Matrix


def compared(values: Vector, components: Sequence[int] | None) -> Vector:
    """Return the components of what is to be sent that a trigger looks at; all of them for None.

    Raises ValueError for a component that there is not.
    """
    if components is None:
        return values
    if max(components) >= values.size:
        raise ValueError(f"the trigger compares component {max(components)} of {values.size}")
    return values[list(components)]


def weight_matrix(weight: float | list[list[float]], name: str) -> Matrix | float:
    """Return a positive definite matrix as stated, or one number that stands for a multiple of the unit.

    Raises ValueError for what is not symmetric and positive definite.
    """
    if isinstance(weight, (int, float)):
        if not weight > 0.0:
            raise ValueError(f"{name} is {weight:g}; it must be positive")
        return float(weight)
    matrix = np.array(weight, dtype=np.float64)
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1] or not np.allclose(matrix, matrix.T):
        raise ValueError(f"{name} is not a symmetric matrix; give rows of equal lengths, or one number")
    if not np.linalg.eigvalsh(matrix)[0] > 0.0:
        raise ValueError(f"{name} is not positive definite")
    return matrix


def sized(weight: Matrix | float, size: int, name: str) -> Matrix:
    """Return a weight as a matrix (size, size); raises ValueError for a matrix of another size."""
    if isinstance(weight, float):
        return weight * np.eye(size)
    if len(weight) != size:
        raise ValueError(f"{name} has {len(weight)} rows for a value of {size} components")
    return weight
