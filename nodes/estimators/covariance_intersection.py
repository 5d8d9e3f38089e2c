"""Covariance intersection with the neighbours: Julier and Uhlmann 1997."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge

from bus.packets import Packet, Vector
from nodes.contract import Matrix, Setting
from nodes.estimators.linear_gaussian import cholesky, correct
from nodes.estimators.local_model import NetworkedFilter, arrived, inverse

Criterion = Literal["trace", "determinant", "fast"]


class CovarianceIntersection(NetworkedFilter):
    """A Kalman filter that fuses its neighbours' estimates whatever the correlation of their errors.

    After its own correction a node sends ``x`` (n) and ``P`` (n * n), and takes of its own and those that
    arrived ``P^-1 = sum_i w_i P_i^-1``, ``x = P sum_i w_i P_i^-1 x_i`` with weights that sum to one
    (Julier, Uhlmann 1997; of several at once: Niehsen 2002). If every P_i is an upper bound on the mean
    square error, so is P, for any correlation and any weights. A neighbour that does not arrive is not
    among them.

    The weights minimise the ``trace`` or the ``determinant`` of P, by sequential quadratic programming
    from equal weights on, or are proportional to ``1 / tr P_i`` (``fast``; Niehsen 2002). The trace
    depends on the units of the state's components.

    Parameters
    ----------
    setting
        Linear models, or models with Jacobians, which are taken as by an extended Kalman filter.
    weights
        How they are chosen, see above.
    rounds_per_step
        The number of exchanges and fusions in a step.

    Raises
    ------
    ValueError
        When the models have neither matrices nor Jacobians, or a sensor's noise or the initial law is
        singular.
    """

    def __init__(
        self,
        setting: Setting,
        *,
        weights: Criterion = "trace",
        rounds_per_step: Annotated[int, Ge(1)] = 1,
    ) -> None:
        super().__init__(setting, rounds=rounds_per_step)
        self._criterion: Criterion = weights

    def correct(self, step: int, packets: Sequence[Packet]) -> Vector | None:
        """Predict and correct by the node's own measurements; return the payload (n + n * n)."""
        own = self._filter
        own.predict(step)
        own.nis, own.nis_dof, own.received = 0.0, 0, 0
        measured = own.measured(step, packets)
        if measured is not None:
            correction = correct(own.state, own.covariance, *measured)
            own.state, own.covariance = correction.state, correction.covariance
            own.nis, own.nis_dof = correction.nis, len(measured.values)
        return self._payload()

    def exchange(self, step: int, round_: int, packets: Sequence[Packet]) -> Vector | None:
        """Intersect with the neighbours that arrived; return the result for the next round."""
        own = self._filter
        n = len(own.state)
        others = arrived(step, n + n * n, packets)
        own.received += len(others)
        if others:
            states = [own.state, *(payload[:n] for payload in others.values())]
            covariances = [own.covariance, *(payload[n:].reshape(n, n) for payload in others.values())]
            own.state, own.covariance = intersect(states, covariances, self._criterion)
        return self._payload()

    def _payload(self) -> Vector:
        return np.concatenate((self._filter.state, self._filter.covariance.ravel()))


def intersect(
    states: Sequence[Vector], covariances: Sequence[Matrix], criterion: Criterion
) -> tuple[Vector, Matrix]:
    """Return the covariance intersection of estimates (n,) with covariances (n, n)."""
    informations = np.array([inverse(covariance) for covariance in covariances])
    if not np.all(np.isfinite(informations)):
        return states[0], np.full_like(covariances[0], np.nan)
    if criterion == "fast":
        traces = np.array([1.0 / float(np.trace(covariance)) for covariance in covariances])
        weights = traces / traces.sum()
    else:
        weights = optimal_weights(informations, criterion)
    fused = inverse(np.tensordot(weights, informations, 1))
    vectors = np.array([information.dot(x) for information, x in zip(informations, states, strict=True)])
    return fused.dot(weights.dot(vectors)), fused


def optimal_weights(informations: Any, criterion: Literal["trace", "determinant"]) -> Vector:
    """Return the weights (N,) on the simplex that minimise trace or log determinant of the fused covariance.

    Both are convex in the weights. ``informations`` (N, n, n) are the inverses of the covariances. They
    are scaled beforehand, so that the same relative accuracy is reached in any unit. Weights that the
    solver could not settle are still such that the result is a bound.
    """
    from scipy import optimize

    minimize: Any = optimize.minimize
    number, n = len(informations), informations.shape[1]
    scaled = informations * (n / float(np.trace(informations.mean(axis=0))))

    def objective(weights: Vector) -> tuple[float, Vector]:
        mixed = np.tensordot(weights, scaled, 1)
        fused = inverse(mixed)
        if criterion == "trace":
            return float(np.trace(fused)), -np.einsum("ij,kji->k", fused.dot(fused), scaled)
        return -2.0 * float(np.log(np.diagonal(cholesky(mixed))).sum()), -np.einsum(
            "ij,kji->k", fused, scaled
        )

    found = minimize(
        objective,
        np.full(number, 1.0 / number),
        jac=True,
        method="SLSQP",
        bounds=[(0.0, 1.0)] * number,
        constraints={"type": "eq", "fun": lambda w: w.sum() - 1.0, "jac": np.ones_like},
        options={"ftol": 1e-10, "maxiter": 100},
    )
    weights = np.clip(np.nan_to_num(found.x), 0.0, 1.0)
    total = float(weights.sum())
    return np.asarray(weights / total if total > 0.0 else np.full(number, 1.0 / number), dtype=np.float64)
