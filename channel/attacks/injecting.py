"""What all attacks share that add packets which nobody sent."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bus.packets import UNSEALED, Packet, Vector
from channel.attacks.laws import CountLaw, Seen, ValueLaw
from channel.contract import Lane, Ledger, Placement, Slot
from channel.draws import SlotStreams

_NOTHING: Vector = np.zeros(0)


class InjectingLane(Lane):
    """A lane that adds packets in the name of ``source``, a law for their number and one for their values.

    Their headers are those of a packet that the source sends in this slot.
    """

    def __init__(
        self,
        placement: Placement,
        link: str,
        source: str,
        count: CountLaw,
        law: ValueLaw,
        slots: SlotStreams,
    ) -> None:
        super().__init__(placement, link)
        self._source = source
        self._kind = placement.kind_on(link)
        self._count = count
        self._law = law
        self._slots = slots
        self._seen = Seen(law.memory)

    def rest(self, slot: Slot, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        """Watch what passes."""
        self._seen.note(packets)
        return packets

    def act(self, slot: Slot, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        """Add false packets to those of a slot."""
        payloads = self._payloads(slot, packets)
        self._seen.note(packets)
        if not payloads:
            return packets
        header = self._header(slot, packets)
        injected = [self.placement.forged(header, values) for values in payloads]
        for packet in injected:
            ledger.injected(self.link, self.label, packet)
        return [*packets, *injected]

    def _payloads(self, slot: Slot, packets: Sequence[Packet]) -> list[Vector] | None:
        generator = self._slots.at(slot.number)
        count = self._count.draw(generator)
        if not count:
            return None
        genuine = packets[-1].values if packets else self._seen.newest
        try:
            return self._law.draw(generator, count, genuine, self._seen.older)
        except ValueError as error:
            raise ValueError(f"{self.label} on {self.link}: {error}") from error

    def _header(self, slot: Slot, packets: Sequence[Packet]) -> Packet:
        """Return a packet with the header of one that the source sends in this slot."""
        for packet in packets:
            if packet.source == self._source and packet.sent_step == slot.step:
                return packet
        check = packets[0].check if packets else UNSEALED
        return Packet(self._source, slot.step, slot.number, self._kind, _NOTHING, check)
