"""The posterior Cramer-Rao bound of a plant that is not linear but has additive Gaussian noise.

For ``x+ = f(x) + w`` and ``y = g(x) + v`` the recursion of Tichavsky, Muravchik and Nehorai (1998, IEEE
Trans. Signal Processing 46:1386, equations 21 and 34 to 36) is::

    J_k+1 = Q^-1 + sum over the sensors that arrived of E[G' R^-1 G] - D' (J_k + E[F' Q^-1 F])^-1 D

with ``D = E[F'] Q^-1`` and the derivatives ``F`` and ``G`` of ``f`` and ``g`` at the true states, over whose
law the expectations are taken: by drawing trajectories, not by a run's own. What is lost must not depend on
the states.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from orchestrator.evidence.models import UnsuitedError
from orchestrator.score.gather import Bools, Floats

DRAWS = 1000
SETTLED = 0.01
"""The largest relative standard error of an expectation that is taken for settled."""
LARGEST_PART = 0.02
"""The largest part of one draw in it: a heavy tail, as beside a kink of the model, shows there first."""
_RELATIVE_STEP = 1e-5

Function = Callable[[Floats], Floats]


@dataclass(frozen=True)
class Expectations:
    """What the recursion needs, by step: ``D11`` and ``D12`` (K, n, n), and ``told`` (K, S, n, n).

    ``Q_inverse`` and ``initial`` (n, n) are the information of the noise and of the initial law.
    """

    D11: Floats
    D12: Floats
    told: Floats
    Q_inverse: Floats
    initial: Floats


def derivatives(function: Function, states: Floats) -> Floats:
    """Return the derivative (N, m, n) of a function at states (N, n), by central differences."""
    columns = []
    for i in range(states.shape[1]):
        step = np.zeros_like(states)
        step[:, i] = _RELATIVE_STEP * np.maximum(1.0, np.abs(states[:, i]))
        columns.append((function(states + step) - function(states - step)) / (2.0 * step[:, i, None]))
    return np.stack(columns, axis=2)


def expectations(
    transition: Function,
    Q: Floats,
    initial_covariance: Floats,
    sensors: Sequence[tuple[Function, Floats]],
    trajectories: Floats,
) -> Expectations:
    """Return the expectations over trajectories (N, K, n) of the plant.

    Parameters
    ----------
    transition, Q, initial_covariance
        The plant: ``f`` from (N, n) to (N, n), and (n, n) each.
    sensors
        ``g`` from (N, n) to (N, m), and ``R`` (m, m), of each sensor.
    trajectories
        Independent draws of the true states.

    Raises
    ------
    UnsuitedError
        When a covariance is singular, or the draws do not settle an expectation.
    """
    n = len(Q)
    Q_inverse, initial = _inverse(Q, "the plant's noise"), _inverse(initial_covariance, "the initial law")
    noises = [(g, _inverse(R, "a sensor's noise")) for g, R in sensors]
    D11, D12, told = [], [], []
    for states in trajectories.transpose(1, 0, 2):
        F = derivatives(transition, states)
        D11.append(_settled(F.transpose(0, 2, 1) @ Q_inverse @ F))
        D12.append(-_settled(F).T @ Q_inverse)
        slopes = [(derivatives(g, states), inverse) for g, inverse in noises]
        told.append([_settled(G.transpose(0, 2, 1) @ inverse @ G) for G, inverse in slopes])
    information = np.array(told).reshape(len(told), len(noises), n, n)
    return Expectations(np.array(D11), np.array(D12), information, Q_inverse, initial)


def _inverse(covariance: Floats, what: str) -> Floats:
    if np.linalg.eigvalsh(covariance)[0] <= 0.0:
        raise UnsuitedError(f"{what} is singular, which the bound of a nonlinear plant cannot be had with")
    return np.asarray(np.linalg.inv(covariance))


def _settled(draws: Floats) -> Floats:
    """Return the mean (n, m) of draws (N, n, m); raises `UnsuitedError` unless it is well known."""
    mean: Floats = draws.mean(axis=0)
    with np.errstate(invalid="ignore", over="ignore"):
        error = np.linalg.norm(draws.std(axis=0, ddof=1)) / np.sqrt(len(draws))
        sizes = np.linalg.norm(draws, axis=(1, 2))
        settled = error <= SETTLED * np.linalg.norm(mean) and sizes.max() <= LARGEST_PART * sizes.sum()
    if not settled:
        raise UnsuitedError("the expectations over the plant's states do not settle")
    return mean


def nonlinear_posterior_bound(expected: Expectations, arrived: Bools) -> Floats:
    """Return the bound (U, K, n, n), given which measurements arrived, by observer, step and sensor."""
    observers, steps, _ = arrived.shape
    n = len(expected.initial)
    told = np.einsum("uks,ksij->ukij", arrived.astype(np.float64), expected.told[:steps])
    bound = np.empty((observers, steps, n, n))
    J: Floats = np.broadcast_to(expected.initial, (observers, n, n))
    eye = np.broadcast_to(np.eye(n), (observers, n, n))
    for k in range(steps):
        if k:
            D12 = np.broadcast_to(expected.D12[k - 1], (observers, n, n))
            J = expected.Q_inverse - D12.transpose(0, 2, 1) @ np.linalg.solve(J + expected.D11[k - 1], D12)
        J = J + told[:, k]
        J = 0.5 * (J + J.transpose(0, 2, 1))
        bound[:, k] = np.linalg.solve(J, eye)
    return bound
