"""Consensus on information: Battistelli and Chisci 2014."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt

from bus.packets import Packet, Vector
from nodes.contract import Matrix, Setting
from nodes.estimators.local_model import ConsensusWeights, NetworkedFilter, arrived, inverse, no_information


class InformationConsensus(NetworkedFilter):
    """A Kalman filter whose information is averaged with that of the neighbours, several times a step.

    Each node takes ``Omega = P^-1 + omega C' R^-1 C`` and ``q = P^-1 x^- + omega C' R^-1 y``, and R times
    the weighted mean of its own pair and those of the neighbours (Battistelli, Chisci 2014; with
    ``omega``: Battistelli, Chisci, Mugnai, Farina, Graziano 2015). Then ``x^+ = Omega^-1 q``, ``P^+ =
    Omega^-1``. The packet is ``q`` (n) and ``Omega`` (n * n).

    With ``omega`` 1 each round is a covariance intersection: the covariance is an upper bound, for any
    number of rounds, any graph and any loss. It is a loose one, since each measurement counts with the
    weight of its node. With ``omega`` the number of nodes, and rounds enough to reach the mean, it is the
    centralised Kalman filter; with fewer rounds it counts the measurements of near nodes too often.

    Consensus on ``measurements`` averages ``omega C' R^-1 y`` and ``omega C' R^-1 C`` alone, and adds the
    node's own prior afterwards. Without many rounds nothing bounds its covariance.

    The weight of a neighbour that did not arrive falls to the node itself; see `ConsensusWeights`.

    Parameters
    ----------
    setting
        Linear models, or models with Jacobians, which are taken as by an extended Kalman filter.
    rounds_per_step
        The number R of averagings in a step.
    omega
        Weight of the measurements against the prior.
    consensus_on
        What is averaged, see above.

    Raises
    ------
    ValueError
        When the models have neither matrices nor Jacobians, a sensor's noise or the initial law is
        singular, or the weights cannot be those of a mean.
    """

    def __init__(
        self,
        setting: Setting,
        *,
        rounds_per_step: Annotated[int, Ge(1)] = 1,
        omega: Annotated[float, Gt(0.0)] = 1.0,
        consensus_on: Literal["information", "measurements"] = "information",
    ) -> None:
        super().__init__(setting, rounds=rounds_per_step)
        self._weights = ConsensusWeights(setting)
        self._omega = omega
        self._with_prior = consensus_on == "information"
        self._pair: Vector = np.empty(0)
        self._prior: tuple[Vector, Matrix] = no_information(len(self._filter.state))

    def correct(self, step: int, packets: Sequence[Packet]) -> Vector | None:
        """Predict, and return the information of the node's own measurements, with its prior or without."""
        own = self._filter
        vector, matrix = own.begin(step, packets)
        prior = inverse(own.covariance)
        self._prior = prior.dot(own.state), prior
        self._pair = self._omega * np.concatenate((vector, matrix.ravel()))
        if self._with_prior:
            self._pair = self._pair + np.concatenate((self._prior[0], prior.ravel()))
        if not self.rounds:
            self._settle()
        return self._pair

    def exchange(self, step: int, round_: int, packets: Sequence[Packet]) -> Vector | None:
        """Average with the neighbours that arrived; return the mean for the next round."""
        others = arrived(step, self._pair.size, packets)
        self._filter.received += len(others)
        self._pair = self._weights.mean(self._pair, others)
        if round_ == self.rounds - 1:
            self._settle()
        return self._pair

    def _settle(self) -> None:
        """Turn the information into state and covariance."""
        own = self._filter
        n = len(own.state)
        vector, matrix = self._pair[:n], self._pair[n:].reshape(n, n)
        if not self._with_prior:
            vector, matrix = vector + self._prior[0], matrix + self._prior[1]
        own.covariance = inverse(matrix)
        own.state = own.covariance.dot(vector)
