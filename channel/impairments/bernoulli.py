"""Losses that do not look at one another, or only a little."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from bus.packets import Packet
from bus.quantities import Probability
from channel.contract import Lane, Ledger, Placement, Slot
from channel.draws import Correlation, SteppedFates, chances


class Bernoulli:
    """Loses the packets of a slot together, with a fixed probability, independently over steps.

    Parameters
    ----------
    loss
        The probability that a slot's packets are lost.
    correlation
        Of the normal numbers from which fates of successive steps are made (a Gaussian copula): losses then
        come in clusters, and the probability of each stays exact.
    """

    open_loop: ClassVar[bool] = True

    def __init__(self, placement: Placement, *, loss: Probability, correlation: Correlation = 0.0) -> None:
        self._placement = placement
        self._losses = placement.by_link(lambda generator: chances(generator, loss, correlation))

    def lane(self, link: str) -> Lane:
        """Return what it does on a link."""
        return _BernoulliLane(self._placement, link, self._losses[link])


class _BernoulliLane(Lane):
    def __init__(self, placement: Placement, link: str, losses: SteppedFates[bool]) -> None:
        super().__init__(placement, link)
        self._lost = losses.at
        self._next = losses.next

    def act(self, slot: Slot, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        if not self._lost(slot.step):
            return packets
        for packet in packets:
            ledger.lost(self.link, self.label, packet)
        return ()

    def quiet_until(self, step: int) -> int:
        return self._next(step)
