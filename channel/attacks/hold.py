"""Old news: the last value before the attack, again and again."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from bus.packets import Packet, Vector
from channel.attacks.falsifying import FalsifyingLane, Part
from channel.contract import Lane, Ledger, Placement, Slot


class Hold:
    """Puts the payload of the last packet before the attack began in place of every later one.

    The headers stay as they are, so that the packets look new. When no packet passed before the attack, the
    first one of the attack passes, and is held from then on. Where a schedule lets the attack rest and begin
    anew, the last packet before the new beginning is held.

    Parameters
    ----------
    components
        The indices of the payload that are held; all of them when not given.
    """

    open_loop: ClassVar[bool] = False

    def __init__(self, placement: Placement, *, components: list[int] | None = None) -> None:
        self._placement = placement
        self._part = Part(components)

    def lane(self, link: str) -> Lane:
        """Return what it does on a link."""
        return _HoldLane(self._placement, link, self._part)


class _HoldLane(FalsifyingLane):
    cure = "name 'components' that it has"
    _last: Vector | None = None

    def rest(self, slot: Slot, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        if packets:
            self._last = packets[-1].values
        return packets

    def act(self, slot: Slot, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        if self._last is None and packets:
            self._last = packets[0].values
        return super().act(slot, packets, ledger)

    def false(self, slot: Slot, values: Vector) -> Vector | None:
        return None if self._last is None else self._last[self.part.index]
