"""Reordering: packets that later ones overtake."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, ClassVar

from annotated_types import Ge

from bus.packets import Packet
from bus.quantities import Probability
from channel.contract import Lane, Ledger, Placement, Slot
from channel.draws import Correlation, SteppedFates, chances


class Reorder:
    """Holds some packets back for a number of slots, so that those of the slots between pass them.

    Parameters
    ----------
    probability
        The probability that a step's packets are held.
    hold
        For how many slots of the link; a link has one slot a step, or one for each exchange round.
    correlation
        Of the normal numbers from which fates of successive steps are made (a Gaussian copula); the
        probability of each stays exact.
    """

    open_loop: ClassVar[bool] = True

    def __init__(
        self,
        placement: Placement,
        *,
        probability: Probability,
        hold: Annotated[int, Ge(1)] = 1,
        correlation: Correlation = 0.0,
    ) -> None:
        self._placement = placement
        self._hold = hold
        self._fates = placement.by_link(lambda generator: chances(generator, probability, correlation))

    def lane(self, link: str) -> Lane:
        """Return what it does on a link."""
        return _ReorderLane(self._placement, link, self._fates[link], self._hold)


class _ReorderLane(Lane):
    def __init__(self, placement: Placement, link: str, fates: SteppedFates[bool], hold: int) -> None:
        super().__init__(placement, link)
        self._is_held = fates.at
        self._next = fates.next
        self._hold = hold
        self._waiting: dict[int, Sequence[Packet]] = {}

    def act(self, slot: Slot, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        if packets and self._is_held(slot.step):
            self._waiting[slot.number + self._hold] = packets
            self.held += len(packets)
            for packet in packets:
                ledger.delayed(self.link, self.label, packet, self._hold)
            packets = ()
        return self.rest(slot, packets, ledger) if self._waiting else packets

    def rest(self, slot: Slot, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        due = self._waiting.pop(slot.number, None)
        if due is None:
            return packets
        self.held -= len(due)
        return (*due, *packets)

    def quiet_until(self, step: int) -> int:
        return self._next(step)
