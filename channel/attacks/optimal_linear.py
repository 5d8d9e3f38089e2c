"""Optimal linear deception of a remote estimator that is sent innovations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from bus.packets import Packet, Vector
from channel.contract import Lane, Ledger, Placement, Slot
from channel.draws import SteppedVectors
from channel.known_model import Matrix


class OptimalLinear:
    """Replaces an innovation ``z`` by ``T z + b`` with ``b ~ N(0, S - T S T')``.

    What arrives has the law of a genuine innovation, ``N(0, S)``, so that a chi-square detector raises no
    more alarms than without an attack (Guo, Shi, Johansson, Shi 2017). The error of the remote estimate has
    the covariance ``P + D`` with ``D = A D A' + K (2 S - T S - S T') K'``. ``T = -I`` is the worst: it needs
    no noise, and the last term is ``4 K S K'``.

    It stands on links from sensors of the kind ``innovation``.

    Parameters
    ----------
    T
        One number for a multiple of the identity, from -1 to 1, or the matrix (m, m) row by row.

    Raises
    ------
    ValueError
        When the link leads to no estimator, ``T`` does not fit its innovations, or ``S - T S T'`` is not a
        covariance.
    """

    open_loop: ClassVar[bool] = False
    needs: ClassVar[frozenset[str]] = frozenset({"innovations"})

    def __init__(self, placement: Placement, *, T: float | list[list[float]] = -1.0) -> None:
        self._placement = placement
        self._draws = placement.by_link(lambda rng: SteppedVectors(rng, np.random.Generator.standard_normal))
        known = placement.knowledge["estimators"]
        self._maps: dict[str, tuple[Matrix, Matrix]] = {}
        for link in placement.streams:
            destination = link.partition("->")[2]
            if destination not in known:
                raise ValueError(
                    f"{destination} is no estimator that listens to a sensor; attack a link s1->e1"
                )
            self._maps[link] = _map(T, np.array(known[destination]["S"], dtype=np.float64))

    def lane(self, link: str) -> Lane:
        """Return what it does on the link of a smart sensor."""
        return _OptimalLinearLane(self._placement, link, *self._maps[link], self._draws[link])


class _OptimalLinearLane(Lane):
    def __init__(
        self, placement: Placement, link: str, T: Matrix, factor: Matrix, draws: SteppedVectors
    ) -> None:
        super().__init__(placement, link)
        self._T = T
        self._factor = factor
        self._draws = draws
        self._is_noisy = bool(factor.any())

    def act(self, slot: Slot, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        return [self._falsify(slot, packet, ledger) for packet in packets]

    def _falsify(self, slot: Slot, packet: Packet, ledger: Ledger) -> Packet:
        if packet.values.shape != (len(self._T),):
            raise ValueError(
                f"an innovation on {self.link} has {packet.values.size} values, not {len(self._T)}; "
                "the attack stands on the link of an estimator's only sensor, of the kind 'innovation'"
            )
        values: Vector = self._T.dot(packet.values)
        if self._is_noisy:
            values = values + self._factor.dot(self._draws.at(slot.step, len(values)))
        ledger.attacked(self.link, self.label, packet, float(np.linalg.norm(values - packet.values)))
        return self.placement.forged(packet, values)


def _map(stated: float | list[list[float]], S: Matrix) -> tuple[Matrix, Matrix]:
    """Return ``T`` (m, m) and a factor (m, m) of the covariance of ``b``; raises ValueError."""
    m = len(S)
    T = np.array(stated, dtype=np.float64)
    T = T * np.eye(m) if T.ndim == 0 else T
    if T.shape != (m, m):
        raise ValueError(f"T has the shape {T.shape}, and the innovations {m} components")
    values, vectors = np.linalg.eigh(S - T @ S @ T.T)
    least = 1e-12 * float(np.trace(S))
    if values[0] < -least:
        raise ValueError(
            "S - T S T' is not a covariance: T must not enlarge the innovations; try a smaller T"
        )
    values = np.where(values > least, values, 0.0)
    return T, vectors * np.sqrt(values)
