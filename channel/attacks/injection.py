"""Extra packet injection: fakes beside the genuine packet, and without it (Forti et al. 2019)."""

from __future__ import annotations

from typing import ClassVar

from channel.attacks.injecting import InjectingLane
from channel.attacks.laws import CountLaw, Natural, ValueLaw, count_law
from channel.contract import Lane, Placement
from channel.draws import SlotStreams


class Injection:
    """Adds false packets to each slot, in the name of the link's sender, whether it sent anything or not.

    The receiver gets a set of packets and cannot tell by their headers which is the genuine one, if any
    (Forti, Battistelli, Chisci, Sinopoli 2019, section II).

    Parameters
    ----------
    values
        What the fakes say: `box`, `normal`, `near` or `copied` (see `channel.attacks.laws`). As long as the
        law does not know the size of a payload, nothing is injected.
    count
        How many a slot: a number, or a law `fixed`, `uniform` or `poisson`.
    """

    open_loop: ClassVar[bool] = True

    def __init__(self, placement: Placement, *, values: ValueLaw, count: Natural | CountLaw = 1) -> None:
        self._placement = placement
        self._count, self._law = count_law(count), values
        self._slots = placement.by_link(SlotStreams)

    def lane(self, link: str) -> Lane:
        """Return what it does on a link."""
        source = link.partition("->")[0]
        return InjectingLane(self._placement, link, source, self._count, self._law, self._slots[link])
