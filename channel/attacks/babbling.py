"""A babbling node: it sends far too much (the babbling idiot of fault-tolerant buses)."""

from __future__ import annotations

from typing import ClassVar

from channel.attacks.injecting import InjectingLane
from channel.attacks.laws import CountLaw, Natural, Near, ValueLaw, count_law
from channel.contract import Lane, Placement
from channel.draws import SlotStreams


class Babbling:
    """Adds further packets to each slot that look like the sender's own, near what it says itself.

    The sender is at fault, so it seals them with its own key. Where it sent nothing in a slot they are near
    what it said last; before its first packet there are none.

    Parameters
    ----------
    count
        How many further packets a slot: a number, or a law `fixed`, `uniform` or `poisson`.
    spread
        Half-width of the box around its own values, in the payload's unit: one number, or one a component.
    """

    open_loop: ClassVar[bool] = True
    acts_as_sender: ClassVar[bool] = True

    def __init__(
        self, placement: Placement, *, count: Natural | CountLaw, spread: float | list[float] = 0.0
    ) -> None:
        self._placement = placement
        self._count, self._law = count_law(count), ValueLaw(near=Near(spread))
        self._slots = placement.by_link(SlotStreams)

    def lane(self, link: str) -> Lane:
        """Return what it does on a link."""
        source = link.partition("->")[0]
        return InjectingLane(self._placement, link, source, self._count, self._law, self._slots[link])
