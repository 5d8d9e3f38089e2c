"""Corruption: bits of the payload that flip on the way."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Interval
from msgspec.structs import replace

from bus.packets import Packet, Vector
from bus.quantities import Probability
from channel.contract import Lane, Ledger, Placement, Slot, distance
from channel.draws import Correlation, SlotStreams, SteppedFates, chances

Bits = Annotated[int, Interval(ge=1, le=52)]

_WORD = 64


def flipped(values: Vector, bits: int, generator: np.random.Generator) -> Vector:
    """Return values (m,), at least one, of whose IEEE-754 bits a drawn set of so many is flipped.

    The set is drawn again while a value would be infinite or no number, which JSON cannot hold. The fraction
    of one value alone has 52 bits to flip that keep it finite, so that a set is found.
    """
    while True:
        places: set[int] = set()
        while len(places) < bits:
            places.add(int(generator.integers(_WORD * values.size)))
        changed = values.copy()
        words = changed.view(np.uint64)
        for place in places:
            words[place // _WORD] ^= np.uint64(1 << place % _WORD)
        if np.isfinite(changed).all():
            return changed


class Corrupt:
    """Flips bits of what packets say. Their seals stay: a receiver that checks them refuses the packets.

    Senders on its links seal their packets with a check sum, unless the topology says otherwise.

    Parameters
    ----------
    probability
        The probability that a step's packets are corrupted.
    bits
        The number of bits that flip in a packet, anywhere in its values.
    correlation
        Of the normal numbers from which fates of successive steps are made (a Gaussian copula); the
        probability of each stays exact.
    """

    open_loop: ClassVar[bool] = True
    default_integrity: ClassVar[str] = "crc"

    def __init__(
        self,
        placement: Placement,
        *,
        probability: Probability,
        bits: Bits = 1,
        correlation: Correlation = 0.0,
    ) -> None:
        self._placement = placement
        self._bits = bits
        self._struck = placement.by_link(lambda generator: chances(generator, probability, correlation))
        self._streams = placement.by_link(SlotStreams)

    def lane(self, link: str) -> Lane:
        """Return what it does on a link."""
        return _CorruptLane(self._placement, link, self._struck[link], self._streams[link], self._bits)


class _CorruptLane(Lane):
    def __init__(
        self, placement: Placement, link: str, struck: SteppedFates[bool], streams: SlotStreams, bits: int
    ) -> None:
        super().__init__(placement, link)
        self._is_struck = struck.at
        self._next = struck.next
        self._streams = streams
        self._bits = bits

    def act(self, slot: Slot, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        if not self._is_struck(slot.step) or not packets:
            return packets
        generator = self._streams.at(slot.number)
        return [self._corrupted(packet, generator, ledger) for packet in packets]

    def _corrupted(self, packet: Packet, generator: np.random.Generator, ledger: Ledger) -> Packet:
        if not packet.values.size:
            return packet
        values = flipped(packet.values, self._bits, generator)
        ledger.altered(self.link, self.label, packet, distance(values, packet.values))
        return replace(packet, values=values)

    def quiet_until(self, step: int) -> int:
        return self._next(step)
