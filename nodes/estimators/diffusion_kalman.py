"""The diffusion Kalman filter of Cattivelli and Sayed 2010."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bus.packets import Packet, Vector
from nodes.contract import Setting
from nodes.estimators.local_model import ConsensusWeights, NetworkedFilter, arrived, no_information


class DiffusionKalman(NetworkedFilter):
    """A Kalman filter on the measurements of a node and its neighbours, and then a mean of their estimates.

    In the first round the nodes exchange ``C' R^-1 y`` (n) and ``C' R^-1 C`` (n * n), and each corrects
    by all that arrived (the incremental step); in the second they exchange the corrected states psi (n),
    and each takes a weighted mean of its own and those that arrived (the diffusion step; Cattivelli,
    Sayed 2010, algorithm 2). The weight of a neighbour that did not arrive falls to the node itself; see
    `ConsensusWeights`.

    The covariance that it publishes is that of the incremental step, as in the paper: what the mean does
    to the error is left out, because the covariances between neighbours are not known. The mean usually
    lessens the error. On a complete graph without loss all psi are equal, and the filter is the
    centralised one.

    Parameters
    ----------
    setting
        Linear models, or models with Jacobians, which are taken as by an extended Kalman filter.

    Raises
    ------
    ValueError
        When the models have neither matrices nor Jacobians, a sensor's noise or the initial law is
        singular, or the weights cannot be those of a mean.
    """

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting, rounds=2)
        self._weights = ConsensusWeights(setting)
        self._information = no_information(len(self._filter.state))

    def correct(self, step: int, packets: Sequence[Packet]) -> Vector | None:
        """Predict; return the information of the node's own measurements (n + n * n)."""
        own = self._filter
        vector, matrix = self._information = own.begin(step, packets)
        if not self.rounds:
            own.add_information(vector, matrix)
        return np.concatenate((vector, matrix.ravel()))

    def exchange(self, step: int, round_: int, packets: Sequence[Packet]) -> Vector | None:
        """Correct by all information that arrived and return the state (n,), then take the mean of states.

        ``neighbours_received`` counts those whose information arrived.
        """
        own = self._filter
        n = len(own.state)
        if round_ == 1:
            own.state = self._weights.mean(own.state, arrived(step, n, packets))
            return None
        vector, matrix = self._information
        others = arrived(step, n + n * n, packets)
        own.received = len(others)
        for payload in others.values():
            vector = vector + payload[:n]
            matrix = matrix + payload[n:].reshape(n, n)
        own.add_information(vector, matrix)
        return own.state
