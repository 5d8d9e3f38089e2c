"""The linear-quadratic regulator."""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_discrete_are

from nodes.contract import ControllerSetting, LinearPlant, Matrix
from nodes.controllers.state_feedback import StateFeedback, input_matrix
from nodes.gaussian import Gaussian

Weight = list[float] | list[list[float]]


class Lqr(StateFeedback):
    """State feedback with the gain that minimises the long-run cost ``E (x - r)' V (x - r) + u' U u``.

    ``K = (U + B' X B)^-1 B' X A`` with the stabilising solution ``X`` of the discrete algebraic Riccati
    equation; with the estimate of a Kalman filter this is the LQG controller. The cost is that of the
    plant and the reference alone: a watermark adds to it.

    Parameters
    ----------
    setting
        The node's model of the plant: a linear one with an input matrix ``B`` (n, p).
    state_weight
        ``V``, positive semidefinite: its diagonal (n), or the whole matrix (n, n).
    input_weight
        ``U``, positive definite: its diagonal (p), or the whole matrix (p, p).
    reference
        The state ``r`` (n,) to be held; the origin when not given.
    watermark
        Law of the watermark, as in `StateFeedback`.

    Raises
    ------
    ValueError
        When the plant is not linear or has no input, a weight has another shape or definiteness, or no gain
        stabilises the plant.
    """

    def __init__(
        self,
        setting: ControllerSetting,
        *,
        state_weight: list[float] | list[list[float]],
        input_weight: list[float] | list[list[float]],
        reference: list[float] | None = None,
        watermark: Gaussian | None = None,
    ) -> None:
        plant, B = setting.plant, input_matrix(setting)
        if not isinstance(plant, LinearPlant):
            raise ValueError(f"{setting.name}: the plant is not linear; give a gain with 'state_feedback'")
        A: Matrix = plant.A
        V = _weight(setting.name, "state_weight", state_weight, len(A), definite=False)
        U = _weight(setting.name, "input_weight", input_weight, B.shape[1], definite=True)
        gain = optimal_gain(setting.name, A, B, V, U)
        super().__init__(setting, gain=gain, reference=reference, watermark=watermark)


def optimal_gain(name: str, A: Matrix, B: Matrix, V: Matrix, U: Matrix) -> list[list[float]]:
    """Return the steady-state gain (p, n) by rows; raises ValueError when it does not stabilise the plant."""
    try:
        X = np.asarray(solve_discrete_are(A, B, V, U), dtype=np.float64)
        gain = np.linalg.solve(U + B.T @ X @ B, B.T @ X @ A)
        radius = float(np.abs(np.linalg.eigvals(A - B @ gain)).max())
    except np.linalg.LinAlgError:
        radius = np.inf
    if not radius < 1.0:
        raise ValueError(
            f"{name}: no gain of these weights stabilises the plant; give it inputs that reach every "
            "unstable mode, and 'state_weight' entries that see it"
        )
    rows: list[list[float]] = gain.tolist()
    return rows


def _weight(name: str, what: str, stated: Weight, size: int, *, definite: bool) -> Matrix:
    """Return a weight (size, size); raises ValueError on another shape or definiteness."""
    given = np.array(stated, dtype=np.float64)
    matrix: Matrix = np.diag(given) if given.ndim == 1 else given
    if matrix.shape != (size, size) or not np.allclose(matrix, matrix.T):
        raise ValueError(f"{name}: {what} must be {size} numbers, or a symmetric matrix of {size} rows")
    least, rounding = float(np.linalg.eigvalsh(matrix)[0]), 1e-12 * float(np.trace(matrix))
    if least <= rounding if definite else least < -rounding:
        raise ValueError(f"{name}: {what} must be positive {'definite' if definite else 'semidefinite'}")
    return matrix
