"""Whether the upper bound of `SecureDistributed` stays bounded: the paper's condition and the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincc

from nodes.contract import Matrix

Stack = NDArray[np.float64]


@dataclass(frozen=True)
class SufficientCondition:
    """The numbers of Theorem 4 (Ding 2021): boundedness is proved when ``xi_q < 1`` and ``xi_p < 1``."""

    zeta: float
    xi_q: float
    xi_p: float

    @property
    def holds(self) -> bool:
        """Whether the theorem applies."""
        return self.xi_q < 1.0 and self.xi_p < 1.0


def sufficient_condition(
    A: Matrix,
    Cs: Sequence[Matrix],
    *,
    failure: float,
    recovery: float,
    coupling: float,
    degrees: Sequence[int],
    threshold: float,
    nu: float = 0.0,
) -> SufficientCondition:
    """Evaluate (42), (43) as they are printed.

    Parameters
    ----------
    A
        Dynamics (n, n).
    Cs
        Measurement matrices (m_i, n), one a node.
    failure, recovery
        ``p`` and ``q`` of the Gilbert-Elliott channel, a step.
    coupling
        ``kappa``.
    degrees
        Number of neighbours of each node.
    threshold
        The detector's; its ``sigma`` is the chance that a chi-squared variable of m degrees of freedom
        exceeds it.
    nu
        Bound on the chance that (25) accepts what (6) rejects: 0, because ``Gamma`` is below ``P``.

    Notes
    -----
    ``zeta`` is at least ``2 + nu - sigma``, so that the condition asks for ``||A|| < 0.71``: no plant with
    an integrator meets it. The proof, (44) and (45), has ``2 kappa`` where (42) and (43) have ``kappa``;
    with it both numbers are larger still.
    """
    norms = [float(np.linalg.norm(C, 2)) for C in Cs]
    sigma = min(float(gammaincc(0.5 * len(C), 0.5 * threshold)) for C in Cs)
    low, high = min(norms) ** 2, max(norms) ** 2
    zeta = ((1.0 + nu) * low + high * (1.0 - sigma)) / low
    growth = zeta * float(np.linalg.norm(A, 2)) ** 2
    coupled = (1.0 + coupling) * (1.0 + coupling * (1 + max(degrees)))
    return SufficientCondition(
        zeta,
        growth * (1.0 - recovery + recovery * coupled),
        growth * (failure + (1.0 - failure) * coupled),
    )


@dataclass(frozen=True)
class Boundedness:
    """Whether the recursion of ``Pi`` settled, after how many steps, and each node's trace of ``Pi^+`` then.

    ``rate`` is the last ratio between the growth of the summed traces in one step and in the step before:
    below 1 they settle geometrically.
    """

    bounded: bool
    steps: int
    rate: float
    traces: tuple[float, ...]


def boundedness(
    A: Matrix,
    Q: Matrix,
    sensors: Sequence[tuple[Matrix, Matrix]],
    adjacency: Matrix,
    coupling: float,
    *,
    max_steps: int = 20_000,
    tolerance: float = 1e-10,
    ceiling: float = 1e12,
) -> Boundedness:
    """Run the recursion (26), (35) of all nodes in the worst case of the channel: every packet arrives.

    It is started at zero, from where it can only grow. The map is monotone and concave, so when it settles
    from there, with a positive definite ``Q``, it does so from every start; and neighbours' packets that are
    lost only lower it. A sensor that is rejected or lost for ever is outside this analysis: ``Pi`` then grows
    without bound unless ``A`` is stable. On the paper's example the limit is near ``kappa * rho = 0.07``,
    with ``rho`` the spectral radius of the adjacency matrix plus the identity: degree + 1 on a regular graph.

    Parameters
    ----------
    A, Q
        Dynamics and process noise (n, n).
    sensors
        ``(C, R)`` of each node's sensor, (m_i, n) and (m_i, m_i).
    adjacency
        (nodes, nodes), not 0 where the row's node receives from the column's.
    coupling
        ``kappa``.
    max_steps
        Steps after which a recursion that neither settled nor passed the ceiling counts as unbounded.
    tolerance
        Relative growth of the summed traces in one step below which the recursion has settled.
    ceiling
        Ratio of the summed traces to those of ``Q`` above which it counts as unbounded.
    """
    C, R = _padded(sensors)
    received = (np.asarray(adjacency) != 0.0).astype(np.float64) + np.eye(len(sensors))
    bounds = np.zeros((len(sensors), *A.shape))
    limit = ceiling * len(sensors) * float(np.trace(Q))
    total, growth, rate = 0.0, 0.0, float("inf")
    for step in range(1, max_steps + 1):
        bounds = _step(bounds, A, Q, C, R, received, coupling)
        traces = np.trace(bounds, axis1=1, axis2=2)
        before, total = total, float(traces.sum())
        rate = (total - before) / growth if growth > 0.0 else float("inf")
        growth = total - before
        if growth <= tolerance * total:
            return Boundedness(True, step, rate, tuple(traces.tolist()))
        if total > limit:
            break
    return Boundedness(False, step, rate, tuple(traces.tolist()))


def largest_bounded_coupling(
    A: Matrix,
    Q: Matrix,
    sensors: Sequence[tuple[Matrix, Matrix]],
    adjacency: Matrix,
    *,
    relative_accuracy: float = 0.01,
) -> float:
    """Return the coupling (0 to 1) up to which `boundedness` holds, by bisection; 0 when it never does."""
    low, high = 0.0, 1.0
    while high - low > relative_accuracy * high and high > 1e-6:
        middle = 0.5 * (low + high)
        bounded = boundedness(A, Q, sensors, adjacency, middle, max_steps=4000, tolerance=1e-8).bounded
        low, high = (middle, high) if bounded else (low, middle)
    return low


def _padded(sensors: Sequence[tuple[Matrix, Matrix]]) -> tuple[Stack, Stack]:
    """Return (nodes, m, n) and (nodes, m, m) with the largest m; added outputs measure nothing."""
    m = max(len(C) for C, _ in sensors)
    all_C = np.zeros((len(sensors), m, sensors[0][0].shape[1]))
    all_R = np.tile(np.eye(m), (len(sensors), 1, 1))
    for at, (C, R) in enumerate(sensors):
        all_C[at, : len(C)] = C
        all_R[at, : len(C), : len(C)] = R
    return all_C, all_R


def _step(
    bounds: Stack, A: Matrix, Q: Matrix, C: Stack, R: Stack, received: Matrix, coupling: float
) -> Stack:
    """Return ``Pi^+`` (nodes, n, n) of the next step, given that of this one, by (26) and (35)."""
    spread = 2.0 * np.tensordot(received, bounds, axes=1)
    predicted = A @ ((1.0 + coupling) * (bounds + coupling * spread)) @ A.T + Q
    projected = C @ predicted
    innovation = projected @ C.swapaxes(1, 2) + R
    corrected = predicted - projected.swapaxes(1, 2) @ np.linalg.solve(innovation, projected)
    half: Stack = 0.5 * corrected
    return half + half.swapaxes(1, 2)
