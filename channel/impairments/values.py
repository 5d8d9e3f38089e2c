"""What changes packets' values by one function: each packet is worked out once for all its links."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from msgspec.structs import replace

from bus.packets import Packet, Vector
from channel.contract import Lane, Ledger, Placement, Slot, distance


class ValueFunction:
    """Applies a function of values to packets; lists, because most payloads are short.

    Most links of a sender are given the same packets of a slot: the last ones are remembered. A seal that
    fitted before is made anew, as if the sender had sealed what it says now; one that did not fit stays.
    """

    def __init__(self, placement: Placement, function: Callable[[list[float]], list[float]]) -> None:
        self._placement = placement
        self._function = function
        self.packets: Sequence[Packet] = ()
        self.changed: Sequence[Packet] = ()
        """What the function makes of them; the very same when it changes none."""
        self.changes: list[float] = []
        """The norm of the change of each."""

    def take(self, packets: Sequence[Packet]) -> None:
        """Apply the function to the packets of a slot."""
        changed = []
        changes = []
        for packet in packets:
            numbers: list[float] = packet.values.tolist()
            new = self._function(numbers)
            values = packet.values if new is numbers else np.array(new)
            change = 0.0 if new is numbers else distance(values, packet.values)
            changed.append(self._sealed(packet, values) if change else packet)
            changes.append(change)
        self.packets, self.changes = packets, changes
        self.changed = changed if any(changes) else packets

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
        function = self._function
        if packets is not function.packets:
            function.take(packets)
        if function.changed is packets:
            return packets
        for packet, change in zip(packets, function.changes, strict=True):
            if change:
                ledger.altered(self.link, self.label, packet, change)
        return function.changed
