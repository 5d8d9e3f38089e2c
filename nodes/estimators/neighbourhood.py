"""What an estimator makes of its neighbours' payloads in one exchange."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np

from bus.packets import Packet, Vector
from nodes.contract import Matrix, Setting

Mixing = Callable[[Sequence[float]], Matrix]


class Neighbourhood:
    """Mixes a node's own payload with those of the neighbours whose packets arrived.

    Each link has its own arrival flag ``delta_ij``, so the term that draws node i towards its neighbours is
    ``xi_i = sum_j h_ij delta_ij (x_j - x_i)``. With one flag a node (Ding 2021, eqs (3), (4), (7)), where a
    lost estimate counts as zero, unequal losses would draw the estimate towards the origin; when all links
    share one channel the two are the same.

    Parameters
    ----------
    setting
        Names the neighbours and their weights h_ij.
    mixing
        Given the weights of the r neighbours that arrived, returns the matrix (rows, r + 1) that is applied
        to the payloads stacked row by row, the node's own first.
    """

    def __init__(self, setting: Setting, mixing: Mixing) -> None:
        self._weights = dict(setting.neighbours)
        self._matrix = lru_cache(maxsize=1024)(
            lambda sources: np.ascontiguousarray(mixing([self._weights[source] for source in sources]))
        )

    def mix(self, step: int, own: Vector, packets: Sequence[Packet]) -> tuple[int, Matrix | None]:
        """Return how many neighbours arrived and the mixture (rows, size), None when none did.

        Not used are packets that were sent in an earlier step, and payloads of another size than the node's
        own: neighbours run the same method on the same plant, so those are malformed. Of several packets from
        one neighbour the last counts.
        """
        arrived = {
            packet.source: packet.values
            for packet in packets
            if packet.sent_step == step and packet.values.size == own.size
        }
        if not arrived:
            return 0, None
        payloads = np.array([own, *arrived.values()])
        return len(arrived), self._matrix(tuple(arrived)).dot(payloads)


def state_mixing(coupling: float, weights: Sequence[float]) -> list[float]:
    """Return the row that makes ``x + kappa sum_j h_j (x_j - x)`` of the stacked states (Ding 2021, (7))."""
    return [1.0 - coupling * sum(weights), *(coupling * weight for weight in weights)]
