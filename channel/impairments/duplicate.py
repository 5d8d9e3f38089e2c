"""Duplication: a network that delivers a packet twice."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from bus.packets import Packet
from bus.quantities import Probability
from channel.contract import Lane, Ledger, Placement, Slot
from channel.draws import Correlation, SteppedFates, chances


class Duplicate:
    """Delivers the packets of a slot twice; the copies meet the later stages as packets of their own.

    Parameters
    ----------
    probability
        The probability that a step's packets are duplicated.
    correlation
        Of the normal numbers from which fates of successive steps are made (a Gaussian copula); the
        probability of each stays exact.
    """

    open_loop: ClassVar[bool] = True

    def __init__(
        self, placement: Placement, *, probability: Probability, correlation: Correlation = 0.0
    ) -> None:
        self._placement = placement
        self._doubled = placement.by_link(lambda generator: chances(generator, probability, correlation))

    def lane(self, link: str) -> Lane:
        """Return what it does on a link."""
        return _DuplicateLane(self._placement, link, self._doubled[link])


class _DuplicateLane(Lane):
    def __init__(self, placement: Placement, link: str, doubled: SteppedFates[bool]) -> None:
        super().__init__(placement, link)
        self._is_doubled = doubled.at
        self._next = doubled.next

    def act(self, slot: Slot, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        if not self._is_doubled(slot.step):
            return packets
        for packet in packets:
            ledger.duplicated(self.link, self.label, packet)
        return (*packets, *packets)

    def quiet_until(self, step: int) -> int:
        return self._next(step)
