"""What changes packets' values by one function: each packet is worked out once for all its links."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from msgspec.structs import replace

from bus.packets import Packet, Vector
from channel.contract import Lane, Ledger, Placement, Slot, distance


class ValueFunction:
    """Applies a function of values to packets; lists, because most payloads are short.

    A sender's packet is the same object on all the links that leave it: the last of each source is
    remembered. A seal that fitted before is made anew, as if the sender had sealed what it says now; one
    that did not fit stays as it is.
    """

    def __init__(self, placement: Placement, function: Callable[[list[float]], list[float]]) -> None:
        self._placement = placement
        self._function = function
        self._last: dict[str, tuple[Packet, Packet, float]] = {}
        self.unchanged: Sequence[Packet] = ()
        """The last packets of a slot in which nothing changed: most links of a sender are given the same."""

    def of(self, packet: Packet) -> tuple[Packet, float]:
        """Return the changed packet and the norm of the change; the packet itself when nothing changed."""
        last = self._last.get(packet.source)
        if last is not None and last[0] is packet:
            return last[1], last[2]
        numbers: list[float] = packet.values.tolist()
        new = self._function(numbers)
        values = packet.values if new is numbers else np.array(new)
        change = 0.0 if new is numbers else distance(values, packet.values)
        changed = self._sealed(packet, values) if change else packet
        self._last[packet.source] = (packet, changed, change)
        return changed, change

    def _sealed(self, packet: Packet, values: Vector) -> Packet:
        forger = self._placement.forger
        if forger is not None and forger.seal(packet) == packet.check:
            return self._placement.forged(packet, values)
        return replace(packet, values=values)


class ValueLane(Lane):
    """A link on which a function changes the values of every packet."""

    def __init__(self, placement: Placement, link: str, function: ValueFunction) -> None:
        super().__init__(placement, link)
        self._function = function

    def act(self, slot: Slot, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        """Return the changed packets, and note those that changed."""
        if packets is self._function.unchanged:
            return packets
        changed = []
        is_same = True
        for packet in packets:
            new, change = self._function.of(packet)
            if new is not packet:
                is_same = False
                ledger.altered(self.link, self.label, packet, change)
            changed.append(new)
        if not is_same:
            return changed
        self._function.unchanged = packets
        return packets
