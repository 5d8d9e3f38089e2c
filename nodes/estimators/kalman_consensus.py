"""The Kalman-consensus filter of Olfati-Saber 2007, 2009."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from annotated_types import Ge

from bus.packets import Packet, Vector
from nodes.contract import Setting
from nodes.estimators.local_model import NetworkedFilter, arrived, no_information


class KalmanConsensus(NetworkedFilter):
    """A filter on the measurements of a node and its neighbours, drawn towards the neighbours' predictions.

    With ``y = sum_j C_j' R_j^-1 y_j`` and ``S = sum_j C_j' R_j^-1 C_j`` over the node and the neighbours
    that arrived (Olfati-Saber 2009, algorithm 1)::

        x^+ = x^- + M (y - S x^-) + gamma P^- sum_j (x_j^- - x^-),   M = (P^-1 + S)^-1

    and ``gamma = gain / (1 + |P^-|)`` in Frobenius' norm. The packet is ``C' R^-1 y`` (n), ``C' R^-1 C``
    (n * n) and ``x^-`` (n). A neighbour that does not arrive is left out of all three sums.

    The covariance ``M`` that it publishes is that of the filter without its consensus term: it knows
    neither what the term does nor that neighbours' errors are correlated. With ``gain`` 0 it is exact.

    Parameters
    ----------
    setting
        Linear models, or models with Jacobians, which are taken as by an extended Kalman filter.
    gain
        Strength of the consensus term; 0 leaves it out. Too large a gain makes the network diverge.
    share_measurements
        Whether the neighbours' measurements are used; without, only their predictions are.

    Raises
    ------
    ValueError
        When the models have neither matrices nor Jacobians, a sensor's noise is singular, or the initial
        law is.
    """

    def __init__(
        self, setting: Setting, *, gain: Annotated[float, Ge(0.0)] = 0.1, share_measurements: bool = True
    ) -> None:
        super().__init__(setting, rounds=1)
        self._gain = gain
        self._shares = share_measurements
        self._vector, self._matrix = no_information(len(self._filter.state))

    def correct(self, step: int, packets: Sequence[Packet]) -> Vector | None:
        """Predict; return the node's information and its prediction (n + n * n + n)."""
        own = self._filter
        self._vector, self._matrix = own.begin(step, packets)
        if not self.rounds:
            own.add_information(self._vector, self._matrix)
        return np.concatenate((self._vector, self._matrix.ravel(), own.state))

    def exchange(self, step: int, round_: int, packets: Sequence[Packet]) -> Vector | None:
        """Correct by the information of all that arrived, and move towards their predictions."""
        own = self._filter
        n, prior, covariance = len(own.state), own.state, own.covariance
        others = arrived(step, n + n * n + n, packets)
        own.received = len(others)
        vector, matrix, pull = self._vector, self._matrix, np.zeros(n)
        for payload in others.values():
            if self._shares:
                vector = vector + payload[:n]
                matrix = matrix + payload[n : n + n * n].reshape(n, n)
            pull += payload[n + n * n :] - prior
        own.add_information(vector, matrix)
        gamma = self._gain / (1.0 + float(np.linalg.norm(covariance)))
        own.state = own.state + gamma * covariance.dot(pull)
        return None
