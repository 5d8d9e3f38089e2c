"""The lower bound on a covariance that cannot be computed locally (Ding 2021, eqs (17)-(19))."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from nodes.contract import Matrix
from nodes.estimators.linear_gaussian import Correction, Dynamics, Measurement, cholesky
from nodes.lapack import dpotrf, dsyev

EPSILON = float(np.finfo(np.float64).eps)


def loewner_minimum(X: Matrix, Y: Matrix) -> Matrix:
    """Return a symmetric matrix (n, n) that is below both: one of them, or their least eigenvalue times I.

    ``X`` when ``X <= Y``, ``Y`` when ``Y < X``, else ``lambda_min I``, in the semidefinite order (Ding 2021,
    section III). An eigenvalue of ``Y - X`` within rounding of zero counts as zero.
    """
    eigenvalues_X, eigenvalues_Y = dsyev(X, compute_v=0)[0], dsyev(Y, compute_v=0)[0]
    eigenvalues_difference = dsyev(Y - X, compute_v=0)[0]
    rounding = len(X) * EPSILON * max(eigenvalues_X[-1], eigenvalues_Y[-1])
    if eigenvalues_difference[0] >= -rounding:
        return X
    if eigenvalues_difference[-1] < -rounding:
        return Y
    return float(min(eigenvalues_X[0], eigenvalues_Y[0])) * np.eye(len(X))


class LowerBound:
    """The lower bound ``Gamma`` (n, n) on the error covariance of a filter that is coupled to its neighbours.

    After a correction it depends on (18), which needs eigenvalues. That step is put off until its result
    matters: in every branch of (18) ``Gamma^+ <= Gamma^-``, so where ``Gamma^- - kappa Xi`` is not positive
    definite, neither is ``Gamma^+ - kappa Xi``, and (17) takes ``Q`` whatever (18) says.

    Parameters
    ----------
    dynamics
        The plant.
    models
        The sensors by name.
    initial
        Covariance (n, n) of the prior of step 0.
    coupling
        The strength ``kappa`` of the consensus term.
    """

    def __init__(
        self, dynamics: Dynamics, models: Mapping[str, Measurement], initial: Matrix, coupling: float
    ) -> None:
        self._dynamics = dynamics
        self._models = models
        self._coupling = coupling
        self._bound = initial
        self._identity = np.eye(len(initial))
        self._correction: tuple[str, Correction] | None = None
        self._factors_under_Q = {
            source: cholesky(C.dot(dynamics.Q).dot(C.T) + R) for source, (C, R) in models.items()
        }

    def current(self) -> Matrix:
        """Return the bound (n, n) after all that happened so far."""
        if self._correction is not None:
            source, correction = self._correction
            C, R = self._models[source]
            gain = correction.gain()
            reduction = self._identity - gain.dot(C)
            half = 0.5 * (reduction.dot(self._bound).dot(reduction.T) + gain.dot(R).dot(gain.T))
            self._bound = loewner_minimum(self._bound, half + half.T)
            self._correction = None
        return self._bound

    def innovation_factor(self, source: str) -> Matrix:
        """Return the lower Cholesky factor (m, m) of the detector's ``C Gamma^- C' + R`` (25)."""
        bound = self.current()
        if bound is self._dynamics.Q:
            return self._factors_under_Q[source]
        C, R = self._models[source]
        return cholesky(C.dot(bound).dot(C.T) + R)

    def correct(self, source: str, correction: Correction) -> None:
        """Take a measurement that the filter accepted or rejected, with the gain it has for it (18), (19)."""
        self.current()
        self._correction = source, correction

    def predict(self, deduction: Matrix | None) -> None:
        """Move the bound one step (17), (19).

        Parameters
        ----------
        deduction
            ``kappa Xi`` (n, n), where ``Xi`` is twice the sum of the upper bounds of this node and of the
            neighbours that arrived; None when none did.

        Notes
        -----
        The test of (17) is made on ``Gamma^+ - kappa Xi`` instead of ``A (Gamma^+ - kappa Xi) A'``: the
        same for an invertible ``A``, and a smaller, still valid bound for a singular one.
        """
        if deduction is None:
            self._bound = self._dynamics.propagate(self.current())
        elif _is_positive_definite(self._bound - deduction) and _is_positive_definite(
            self.current() - deduction
        ):
            self._bound = self._dynamics.propagate((1.0 - self._coupling) * (self._bound - deduction))
        else:
            self._bound, self._correction = self._dynamics.Q, None


def _is_positive_definite(matrix: Matrix) -> bool:
    """Tell whether a symmetric matrix (n, n) has a Cholesky factor."""
    return bool(dpotrf(matrix)[1] == 0)
