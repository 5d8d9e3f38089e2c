"""Gaussian parameters as a topology states them, and as matrices."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge

from bus.packets import Vector
from nodes.contract import Matrix

Deviation = Annotated[float, Ge(0.0)]


@dataclass(frozen=True)
class Gaussian:
    """A Gaussian law, given by exactly one of ``std`` (one number or one a component) and ``covariance``."""

    std: Deviation | list[Deviation] | None = None
    covariance: list[list[float]] | None = None
    mean: list[float] | None = None

    def mean_vector(self, size: int) -> Vector:
        """Return the mean (size,), zero when not given; raises ValueError on another length."""
        if self.mean is None:
            return np.zeros(size)
        if len(self.mean) != size:
            raise ValueError(f"mean has {len(self.mean)} entries, expected {size}")
        return np.array(self.mean, dtype=np.float64)

    def covariance_matrix(self, size: int) -> Matrix:
        """Return the covariance (size, size); raises ValueError for another shape or an indefinite one."""
        if (self.std is None) == (self.covariance is None):
            raise ValueError("give exactly one of 'std' and 'covariance'")
        if self.std is not None:
            std = np.asarray(self.std, dtype=np.float64)
            if std.ndim and std.shape != (size,):
                raise ValueError(f"std has {std.size} entries, expected 1 or {size}")
            if not np.all(std >= 0.0):
                raise ValueError("std must not be negative")
            return np.diag(np.broadcast_to(std * std, (size,)).copy())
        matrix = np.array(self.covariance, dtype=np.float64)
        if matrix.shape != (size, size):
            raise ValueError(f"covariance has shape {matrix.shape}, expected {(size, size)}")
        if not np.allclose(matrix, matrix.T) or np.linalg.eigvalsh(matrix)[0] < -1e-12 * np.trace(matrix):
            raise ValueError("covariance must be symmetric and positive semidefinite")
        return 0.5 * (matrix + matrix.T)
