"""Innovations of what an estimator published, computed from the record: no estimator has to give them.

From the state and covariance that it published, the plant's model predicts the next measurements; what
arrived less that, whitened by its covariance, is standard normal and independent over steps for an optimal
filter of a linear Gaussian plant, whatever is lost.
"""

from __future__ import annotations

import numpy as np

from orchestrator.score.gather import Floats


def whitened_innovations(
    A: Floats, Q: Floats, C: Floats, R: Floats, state: Floats, covariance: Floats, measured: Floats
) -> Floats:
    """Return the whitened innovations (K, M) of one estimator, NaN where no measurement came.

    ``L^-1 (y - C A x)`` with ``L L' = C (A P A' + Q) C' + R`` over the components that came, in their order.

    Parameters
    ----------
    A, Q
        The plant, (n, n) each.
    C, R
        The sensors that it hears, one over the other: (M, n) and (M, M).
    state, covariance
        What it believed of the step before each step, (K, n) and (K, n, n); NaN where nothing.
    measured
        The measurements of each step (K, M), NaN where none came.
    """
    white = np.full(measured.shape, np.nan)
    usable = np.isfinite(state).all(axis=1) & np.isfinite(covariance).all(axis=(1, 2))
    usable &= np.isfinite(measured).any(axis=1)
    came = np.isfinite(measured[usable])
    predicted = A @ covariance[usable] @ A.T + Q
    S = C @ predicted @ C.T + R
    both = came[:, :, None] & came[:, None, :]
    S = np.where(both, S, np.eye(len(C)))  # a component that did not come stands apart from the others
    innovation = np.where(came, measured[usable] - state[usable] @ (C @ A).T, 0.0)
    factor = _factors(S)
    solved = np.linalg.solve(factor, innovation[:, :, None])[:, :, 0]
    white[usable] = np.where(came, solved, np.nan)
    return white


def _factors(S: Floats) -> Floats:
    """Return lower Cholesky factors (K, M, M); one that does not exist is NaN on its diagonal."""
    try:
        return np.asarray(np.linalg.cholesky(S))
    except np.linalg.LinAlgError:
        definite = np.linalg.eigvalsh(S)[:, 0] > 0.0
        kept = np.where(definite[:, None, None], S, np.eye(S.shape[1]))
        factors = np.asarray(np.linalg.cholesky(kept))
        return np.where(definite[:, None, None], factors, np.nan * np.eye(S.shape[1]))
