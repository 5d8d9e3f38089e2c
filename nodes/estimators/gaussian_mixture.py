"""Gaussian mixtures as stacked arrays: weights as logarithms, no loop over components.

The reduction by pruning, merging and a cap follows Vo and Ma 2006, section III C.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bus.packets import Vector
from nodes.contract import Matrix

Stack = NDArray[np.float64]
"""Matrices (J, rows, columns), one a component."""


class Mixture(NamedTuple):
    """A weighted sum of J Gaussians in d dimensions; its weights need not sum to one.

    ``log_weights`` (J,), ``means`` (J, d), ``covariances`` (J, d, d). Where a state and an attack signal (q,)
    stand side by side, two more arrays belong to the components while a step lasts: ``free`` (J, q, q)
    projects on the directions of the signal that no measurement of the step has fixed, and ``entry`` (J, n,
    q) is how the signal has entered the state. A mixture that lacks one of them has no use for it.
    """

    log_weights: Vector
    means: Matrix
    covariances: Stack
    free: Stack | None = None
    entry: Stack | None = None

    @property
    def size(self) -> int:
        """The number of components."""
        return len(self.log_weights)

    def weighing(self, log_weights: Vector) -> Mixture:
        """Return the same components with other weights."""
        return Mixture(log_weights, *self[1:])

    def log_total(self) -> float:
        """Return the logarithm of the sum of the weights; minus infinity for none."""
        return log_sum(self.log_weights)


def log_sum(log_weights: NDArray[np.float64]) -> float:
    """Return ``log sum exp`` of any number of logarithms without overflow or underflow."""
    if log_weights.size < 2:
        return float(log_weights.item()) if log_weights.size else -math.inf
    largest = float(log_weights.max())
    if not math.isfinite(largest):
        return largest
    return largest + math.log(float(np.exp(log_weights - largest).sum()))


def joined(one: Mixture, other: Mixture) -> Mixture:
    """Return the components of both, without what belongs to them while a step lasts."""
    return Mixture(
        np.concatenate((one.log_weights, other.log_weights)),
        np.concatenate((one.means, other.means)),
        np.concatenate((one.covariances, other.covariances)),
    )


def survivors(log_weights: NDArray[np.float64], pruning: float, most: int) -> NDArray[np.intp]:
    """Return the (flat) indices of the components to keep, heaviest first.

    Those of weight zero go, and those below the share ``pruning`` of the whole, but never the heaviest; of
    the others the ``most`` heaviest stay.
    """
    flat = log_weights.ravel()
    total = log_sum(flat)
    if total == -math.inf:
        return np.zeros(0, dtype=np.intp)
    if flat.size == 1:
        return np.zeros(1, dtype=np.intp)
    floor = total + math.log(pruning) if pruning > 0.0 else -math.inf
    kept = np.flatnonzero((flat > -math.inf) & (flat >= min(floor, float(flat.max()))))
    order: NDArray[np.intp] = kept[np.argsort(-flat[kept], kind="stable")[:most]]
    return order


def merge(mixture: Mixture, threshold: float) -> Mixture:
    """Join components that lie close together; mean and covariance of the whole stay what they are.

    The first component, which should be the heaviest, takes in all whose squared Mahalanobis distance from
    it, each under its own covariance, is at most ``threshold``; then the first that is left, and so on.
    """
    if mixture.size < 2 or threshold <= 0.0:
        return mixture
    factors = inverse_factors(mixture.covariances)
    cluster = np.full(mixture.size, -1)
    count = 0
    while True:
        left = cluster < 0
        if not left.any():
            break
        seed = int(left.argmax())
        away = np.matmul(factors, (mixture.means - mixture.means[seed])[:, :, None])[:, :, 0]
        near = left & (np.einsum("ji,ji->j", away, away) <= threshold)
        near[seed] = True
        cluster[near] = count
        count += 1
    return mixture if count == mixture.size else _joint_moments(mixture, cluster, count)


def _joint_moments(mixture: Mixture, cluster: NDArray[np.int64], count: int) -> Mixture:
    """Return a component with the moments of each of ``count`` clusters (J,)."""
    membership = np.arange(count)[:, None] == cluster
    of_cluster = np.where(membership, mixture.log_weights, -math.inf)
    largest = of_cluster.max(axis=1, keepdims=True)
    shares = np.exp(of_cluster - largest)
    totals = shares.sum(axis=1, keepdims=True)
    shares /= totals
    means = shares.dot(mixture.means)
    deviations = mixture.means - means[cluster]
    spread = mixture.covariances + deviations[:, :, None] * deviations[:, None, :]
    d = means.shape[1]
    covariances = shares.dot(spread.reshape(mixture.size, d * d)).reshape(count, d, d)
    return Mixture((largest + np.log(totals))[:, 0], means, covariances)


def moments(mixture: Mixture) -> tuple[Vector, Matrix]:
    """Return mean (d,) and covariance (d, d) of a mixture with at least one component."""
    whole = _joint_moments(mixture, np.zeros(mixture.size, dtype=np.int64), 1)
    return whole.means[0], symmetric(whole.covariances[0])


def symmetric(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the symmetric part of a matrix, or of each of a stack."""
    half = 0.5 * matrices
    return half + half.swapaxes(-1, -2)


def inverse_factors(covariances: Stack) -> Stack:
    """Return W (J, d, d) with ``W' W`` the inverse of each covariance.

    In a direction that a singular covariance excludes, a distance counts as almost infinite.
    """
    try:
        return np.linalg.inv(np.linalg.cholesky(covariances))
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(covariances)
        floor = np.maximum(1e-14 * values[:, -1:], np.finfo(np.float64).tiny)
        scaled: Stack = (vectors / np.sqrt(np.maximum(values, floor))[:, None, :]).swapaxes(1, 2)
        return scaled
