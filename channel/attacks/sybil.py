"""Sybil packets: a link carries packets in the name of a node that never sent them."""

from __future__ import annotations

from typing import ClassVar

from channel.attacks.injecting import InjectingLane
from channel.attacks.laws import CountLaw, Natural, ValueLaw, count_law
from channel.contract import Lane, Placement
from channel.draws import SlotStreams


class Sybil:
    """Adds packets in the name of another node to each slot.

    The receiver refuses them when it does not listen to that node, or when that node seals its packets by
    ``mac`` and the adversary does not hold the keys. Otherwise they stand among that node's own.

    Parameters
    ----------
    identity
        The node in whose name the packets come.
    values
        What they say: `box`, `normal`, `near` or `copied` (see `channel.attacks.laws`). The last two look at
        the packets of the attacked link, not at those of the identity.
    count
        How many a slot: a number, or a law `fixed`, `uniform` or `poisson`.
    """

    open_loop: ClassVar[bool] = True

    def __init__(
        self, placement: Placement, *, identity: str, values: ValueLaw, count: Natural | CountLaw = 1
    ) -> None:
        own = [link for link in placement.streams if link.partition("->")[0] == identity]
        if own:
            raise ValueError(f"{identity} sends on {own[0]} itself; use 'injection' there")
        self._placement = placement
        self._identity = identity
        self._count, self._law = count_law(count), values
        self._slots = placement.by_link(SlotStreams)

    def lane(self, link: str) -> Lane:
        """Return what it does on a link."""
        return InjectingLane(self._placement, link, self._identity, self._count, self._law, self._slots[link])
