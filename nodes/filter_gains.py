"""The gains of a Kalman filter that misses no measurement: those of its start, or those it settles on."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve, cholesky, solve_discrete_are

from nodes.contract import Matrix
from nodes.linear_algebra import symmetrise

GainKind = Literal["steady", "time_varying"]


class FilterGain(NamedTuple):
    """One step's filter.

    Gain ``K`` (n, m), innovation covariance ``S`` (m, m) with its lower Cholesky ``factor``, and ``P`` (n, n)
    of the corrected state.
    """

    K: Matrix
    S: Matrix
    factor: Matrix
    P: Matrix


class FilterGains:
    """One gain after the other, from step 0 on: whoever knows the model computes the same.

    Parameters
    ----------
    A, Q, C, R
        The model: dynamics (n, n), process noise (n, n), measurement (m, n), measurement noise (m, m).
    initial_covariance
        Covariance (n, n) of the state of step 0.
    kind
        ``time_varying`` follows the Riccati recursion from the initial covariance; ``steady`` takes its limit
        in every step.

    Raises
    ------
    ValueError
        When the noise is singular, or the limit is asked for and there is none.
    """

    def __init__(
        self, A: Matrix, Q: Matrix, C: Matrix, R: Matrix, initial_covariance: Matrix, kind: GainKind
    ) -> None:
        if not np.linalg.eigvalsh(R)[0] > 0.0:
            raise ValueError("the measurement noise is singular; give it a positive std")
        self._A, self._Q, self._C, self._R = A, Q, C, R
        self._prior = initial_covariance
        self._steady = self._at(steady_prior(A, Q, C, R)) if kind == "steady" else None

    def next(self) -> FilterGain:
        """Return the gain of the next step."""
        if self._steady is not None:
            return self._steady
        gain = self._at(self._prior)
        self._prior = symmetrise(self._A @ gain.P @ self._A.T) + self._Q
        return gain

    def _at(self, prior: Matrix) -> FilterGain:
        """Return the gain for a prior covariance (n, n)."""
        C = self._C
        S = symmetrise(C @ prior @ C.T) + self._R
        K: Matrix = cho_solve(cho_factor(S), C @ prior).T
        rest = np.eye(len(prior)) - K @ C
        P = symmetrise(rest @ prior @ rest.T + K @ self._R @ K.T)
        return FilterGain(np.ascontiguousarray(K), S, cholesky(S, lower=True), P)


def steady_prior(A: Matrix, Q: Matrix, C: Matrix, R: Matrix) -> Matrix:
    """Return the limit (n, n) of the prior covariance; raises ValueError when there is none."""
    try:
        prior = np.asarray(solve_discrete_are(A.T, C.T, Q, R), dtype=np.float64)
        gain = np.linalg.solve(C @ prior @ C.T + R, C @ prior @ A.T).T
        radius = float(np.abs(np.linalg.eigvals(A - gain @ C)).max())
    except np.linalg.LinAlgError:
        radius = np.inf
    if not radius < 1.0:
        raise ValueError(
            "the filter of this sensor does not settle: it must see every mode that does not decay, "
            "and process noise must reach it; or take time-varying gains"
        )
    settled: Matrix = 0.5 * (prior + prior.T)
    return settled
