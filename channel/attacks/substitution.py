"""Packet substitution: now and then a genuine packet is replaced by a fake one (Forti et al. 2019)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from bus.packets import Packet
from bus.quantities import Probability
from channel.attacks.falsifying import Part
from channel.attacks.laws import DrawnLane, Seen, ValueLaw
from channel.contract import Lane, Ledger, Placement, Slot
from channel.draws import SlotStreams, SteppedDraws


class Substitution:
    """Replaces the packets of a slot by fakes, with one probability, independently over slots.

    The receiver gets one packet where one was sent, and cannot tell by its header whether it is the genuine
    one (Forti, Battistelli, Chisci, Sinopoli 2019, section II; there the probability is p_f).

    Parameters
    ----------
    probability
        The probability that a slot's packets are replaced.
    values
        What the fakes say: `box`, `normal`, `near` or `copied` (see `channel.attacks.laws`).
    """

    open_loop: ClassVar[bool] = True

    def __init__(self, placement: Placement, *, probability: Probability, values: ValueLaw) -> None:
        self._placement = placement
        self._probability = probability
        self._law = values
        self._draws = placement.by_link(lambda generator: (SteppedDraws(generator), SlotStreams(generator)))

    def lane(self, link: str) -> Lane:
        """Return what it does on a link."""
        return _SubstitutionLane(self._placement, link, self._law, self._probability, *self._draws[link])


class _SubstitutionLane(DrawnLane):
    def __init__(
        self,
        placement: Placement,
        link: str,
        law: ValueLaw,
        probability: float,
        occurrence: SteppedDraws,
        slots: SlotStreams,
    ) -> None:
        super().__init__(placement, link, Part(None))
        self.law = law
        self.seen = Seen(law.memory)
        self._probability = probability
        self._occurs = occurrence.at
        self._slots = slots

    def act(self, slot: Slot, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        passed = packets
        if packets and self._occurs(slot.number) < self._probability:
            self.generator = self._slots.at(slot.number)
            passed = super().act(slot, packets, ledger)
        self.seen.note(packets)
        return passed
