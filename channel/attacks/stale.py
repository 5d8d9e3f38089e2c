"""Old news: what was said some slots ago, with the header of today."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Annotated, ClassVar

from annotated_types import Ge

from bus.packets import Packet, Vector
from channel.attacks.falsifying import FalsifyingLane, Part
from channel.contract import Lane, Ledger, Placement, Slot


class Stale:
    """Puts the payload of ``age`` slots ago in place of that of every packet; the header stays as it is.

    Where that slot was empty, the newest packet before it serves; while there is none, packets pass.

    Parameters
    ----------
    age
        Slots; on an exchange every round has one.
    components
        The indices of the payload that are replaced; all of them when not given.
    """

    open_loop: ClassVar[bool] = False

    def __init__(
        self, placement: Placement, *, age: Annotated[int, Ge(1)], components: list[int] | None = None
    ) -> None:
        self._placement = placement
        self._age = age
        self._part = Part(components)

    def lane(self, link: str) -> Lane:
        """Return what it does on a link."""
        return _StaleLane(self._placement, link, self._part, self._age)


class _StaleLane(FalsifyingLane):
    cure = "name 'components' that it has"

    def __init__(self, placement: Placement, link: str, part: Part, age: int) -> None:
        super().__init__(placement, link, part)
        self._seen: deque[Vector | None] = deque([None] * age, maxlen=age)

    def rest(self, slot: Slot, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        self._note(packets)
        return packets

    def act(self, slot: Slot, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        passed = super().act(slot, packets, ledger)
        self._note(packets)
        return passed

    def false(self, slot: Slot, values: Vector) -> Vector | None:
        old = self._seen[0]
        return None if old is None else old[self.part.index]

    def _note(self, packets: Sequence[Packet]) -> None:
        self._seen.append(packets[-1].values if packets else self._seen[-1])
