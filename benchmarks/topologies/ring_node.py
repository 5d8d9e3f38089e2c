"""A node of the benchmark ring: trivial mathematics, so that what is measured is the exchange."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from bus.packets import Packet, Vector
from nodes.contract import Belief, Setting


class RingNode:
    """Averages what its four neighbours had one step before, as `benchmarks/reference/ring.py` does.

    Node ``i`` (``e1`` is 0) takes ``x_i(k) = 0.9 mean(x_j(k - 1)) + sin(k (i + 1))`` with ``x_i(-1) = 0``.
    Lost packets count as 0.
    """

    rounds = 1

    def __init__(self, setting: Setting) -> None:
        self._number = int(setting.name.lstrip("e"))
        self._neighbours = len(setting.neighbours)
        self._received = 0.0
        self._state: Vector = np.zeros(1)
        self._covariance = np.eye(1)

    def correct(self, step: int, packets: Sequence[Packet]) -> Vector:
        """Take the step and send the new value (1,)."""
        mean = self._received / self._neighbours
        self._state = np.array([0.9 * mean + math.sin(step * self._number)])
        return self._state

    def exchange(self, step: int, round_: int, packets: Sequence[Packet]) -> None:
        """Keep the neighbours' values for the next step."""
        self._received = sum(packet.values.item() for packet in packets)

    def estimate(self, step: int) -> Belief:
        """Publish the value; a covariance of 1 stands for none."""
        return Belief(self._state, self._covariance)
