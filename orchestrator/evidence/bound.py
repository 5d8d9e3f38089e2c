"""The posterior Cramer-Rao bound of a linear Gaussian plant, given which measurements arrived.

Tichavsky, Muravchik and Nehorai (1998, IEEE Trans. Signal Processing 46:1386) give the recursion of the
Bayesian information ``J`` of the state. For ``x+ = A x + w`` and the measurements ``y = C x + v`` that arrive
it is (their equation 21, by the matrix inversion lemma)::

    J_k = (Q + A J_{k-1}^-1 A')^-1 + sum over the sensors that arrived of C' R^-1 C

so that ``J^-1`` is the covariance of the Kalman filter that takes just these measurements. It is computed as
a covariance, which also holds for a plant whose ``Q`` or initial covariance is singular.
"""

from __future__ import annotations

import numpy as np

from orchestrator.score.gather import Bools, Floats


def information(C: Floats, R: Floats) -> Floats:
    """Return ``C' R^-1 C`` (n, n), what a measurement (m,) with noise covariance ``R`` tells of the state."""
    factor = np.linalg.cholesky(R)
    whitened = np.linalg.solve(factor, C)
    told: Floats = whitened.T @ whitened
    return told


def posterior_bound(A: Floats, Q: Floats, initial_covariance: Floats, told: Floats, arrived: Bools) -> Floats:
    """Return the bound (U, K, n, n) on the error covariance of the filtered state.

    Parameters
    ----------
    A, Q, initial_covariance
        The plant, (n, n) each; the measurements of step 0 already correct its initial law.
    told
        What each of S sensors tells when its measurement arrives (S, n, n), see `information`.
    arrived
        Whether it did, by observer, step and sensor (U, K, S).
    """
    observers, steps, _ = arrived.shape
    n = len(A)
    flat = told.reshape(len(told), n * n)
    bound = np.empty((observers, steps, n, n))
    P: Floats = np.broadcast_to(initial_covariance, (observers, n, n))
    eye = np.eye(n)
    for k in range(steps):
        if k:
            P = A @ P @ A.T + Q
        J = (arrived[:, k].astype(np.float64) @ flat).reshape(observers, n, n)
        corrected = np.linalg.solve(eye + P @ J, P)  # (P^-1 + J)^-1, for a singular P as well
        P = 0.5 * (corrected + corrected.transpose(0, 2, 1))
        bound[:, k] = P
    return bound
