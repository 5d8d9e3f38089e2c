"""Bias on measurements that errs as far as a detector's budget allows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Ge, Gt

from bus.packets import Packet, Vector
from channel.contract import Lane, Ledger, Placement, Slot
from channel.known_model import KnownFilter, KnownModel, Matrix
from channel.shifting import ShiftingLane


class WorstCaseBias:
    """Shifts every innovation of a Kalman filter by one vector ``delta`` of a given size for its detector.

    With ``delta' S^-1 delta = budget`` the chi-square statistic of all measurements of a step together is
    noncentral, with the noncentrality ``budget`` in every attacked step (that of one sensor's packet has at
    most that). The error of the estimate has the bias ``eps_k = A eps_{k-1} + K delta``, and the attack adds
    ``a_k = delta + C A eps_{k-1}`` to the measurements: it also covers up for its past. Steady-state bias
    attacks of this kind are those of Mo, Sinopoli 2010 and Teixeira et al. 2015.

    Of all constant ``delta`` this one maximises ``|W sum_{i < N} A^i K delta|``, the bias after N steps. The
    attack stands on the links of all sensors of an estimator. It assumes that the filter has settled, so
    that K and S are those of the steady state, and that nothing is lost.

    Parameters
    ----------
    budget
        Noncentrality, unitless.
    horizon
        N (steps); without it the limit if the plant is stable, and otherwise the length of the window.
    weights
        The diagonal (n,) of ``W``, which tells what the adversary cares for; ones when not given.

    Raises
    ------
    ValueError
        When a sensor of an attacked estimator is left out, or ``weights`` does not fit the state.
    """

    open_loop: ClassVar[bool] = True
    needs: ClassVar[frozenset[str]] = frozenset({"model", "innovations"})

    def __init__(
        self,
        placement: Placement,
        *,
        budget: Annotated[float, Gt(0.0)],
        horizon: Annotated[int, Ge(1)] | None = None,
        weights: list[float] | None = None,
    ) -> None:
        self._placement = placement
        self._model = KnownModel(placement.knowledge)
        n = len(self._model.A)
        if weights is not None and len(weights) != n:
            raise ValueError(f"'weights' has {len(weights)} entries for {n} state components")
        W = np.eye(n) if weights is None else np.diag(np.array(weights, dtype=np.float64))
        length = placement.last - placement.first + 1
        self._shifts: dict[str, tuple[KnownFilter, Vector]] = {}
        for estimator in sorted({link.partition("->")[2] for link in placement.streams}):
            known = self._model.filter_of(estimator)
            left_out = [name for name in known.sensors if f"{name}->{estimator}" not in placement.streams]
            if left_out:
                raise ValueError(
                    f"{estimator} also listens to {', '.join(left_out)}; attack the links of all its sensors"
                )
            reach = W @ _reach(self._model.A, known.K, horizon, length)
            self._shifts[estimator] = known, worst_shift(reach, known.S, budget)

    def lane(self, link: str) -> Lane:
        """Return what it does on the link of a sensor."""
        sensor, _, estimator = link.partition("->")
        known, delta = self._shifts[estimator]
        return _WorstCaseBiasLane(self._placement, link, self._model.A, known, delta, known.rows[sensor])


class _WorstCaseBiasLane(ShiftingLane):
    """Follows the bias ``eps`` (n,) by itself, so that lanes may be called in any order."""

    def __init__(
        self, placement: Placement, link: str, A: Matrix, known: KnownFilter, delta: Vector, rows: slice
    ) -> None:
        super().__init__(placement, link)
        self._A = A
        self._C = known.C
        self._K = known.K
        self._delta = delta
        self._own = rows
        self._bias: Vector = np.zeros(len(A))

    def act(self, slot: Slot, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        predicted = self._A.dot(self._bias)
        added: Vector = self._delta + self._C.dot(predicted)
        self._bias = predicted + self._K.dot(self._delta)
        return self.shifted(packets, added[self._own], ledger)

    def rest(self, slot: Slot, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        if self._bias.any():
            predicted = self._A.dot(self._bias)
            self._bias = predicted - self._K.dot(self._C.dot(predicted))
        return packets


def worst_shift(reach: Matrix, S: Matrix, budget: float) -> Vector:
    """Return the ``delta`` (m,) with ``delta' S^-1 delta = budget`` that maximises ``|reach delta|``.

    Of the two of opposite sign it is the one whose largest effect is positive.
    """
    factor = np.linalg.cholesky(S)
    delta: Vector = np.sqrt(budget) * factor @ np.linalg.svd(reach @ factor)[2][0]
    effect = reach @ delta
    return delta if effect[np.argmax(np.abs(effect))] >= 0.0 else -delta


def _reach(A: Matrix, K: Matrix, horizon: int | None, length: int) -> Matrix:
    """Return ``sum_{i < N} A^i K`` (n, m), or its limit."""
    if horizon is None and np.abs(np.linalg.eigvals(A)).max() < 1.0:
        return np.asarray(np.linalg.solve(np.eye(len(A)) - A, K), dtype=np.float64)
    total: Matrix = K
    for _ in range(1, horizon or length):
        total = A.dot(total) + K
    return total
