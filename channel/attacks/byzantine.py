"""A Byzantine node: it tells each of its neighbours something else."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from bus.packets import Packet
from channel.attacks.falsifying import Part
from channel.attacks.laws import DrawnLane, Near, Seen, ValueLaw
from channel.contract import Lane, Ledger, Placement, Slot
from channel.draws import SlotStreams


class Byzantine:
    """Falsifies every packet of a node, with other values on each of the links that leave it.

    The node itself lies, so it seals what it says with its own key (Lamport, Shostak, Pease 1982 name such
    nodes).

    Parameters
    ----------
    spread
        Half-width of the box around the genuine values, in the payload's unit: one number, or one for each
        attacked component.
    values
        Instead of ``spread``: the law of what it says.
    components
        The indices of the payload that are falsified; all of them when not given.
    """

    open_loop: ClassVar[bool] = True
    acts_as_sender: ClassVar[bool] = True

    def __init__(
        self,
        placement: Placement,
        *,
        spread: float | list[float] | None = None,
        values: ValueLaw | None = None,
        components: list[int] | None = None,
    ) -> None:
        if (spread is None) == (values is None):
            raise ValueError("give exactly one of 'spread' and 'values'")
        if placement.shares_streams:
            raise ValueError("links that share a stream are told the same; leave 'scope' and 'stream' out")
        self._placement = placement
        self._law = values if values is not None else ValueLaw(near=Near(0.0 if spread is None else spread))
        self._part = Part(components, **({} if spread is None else {"spread": spread}))
        self._slots = placement.by_link(SlotStreams)

    def lane(self, link: str) -> Lane:
        """Return what it does on a link."""
        return _ByzantineLane(self._placement, link, self._part, self._law, self._slots[link])


class _ByzantineLane(DrawnLane):
    def __init__(
        self, placement: Placement, link: str, part: Part, law: ValueLaw, slots: SlotStreams
    ) -> None:
        super().__init__(placement, link, part)
        self.law = law
        self.seen = Seen(law.memory)
        self._slots = slots

    def act(self, slot: Slot, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        if not packets:
            return packets
        self.generator = self._slots.at(slot.number)
        passed = super().act(slot, packets, ledger)
        self.seen.note(packets)
        return passed
