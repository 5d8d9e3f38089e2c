"""Independent losses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, ClassVar

from annotated_types import Interval

from bus.packets import Packet
from channel.contract import Ledger, Placement
from channel.draws import SteppedDraws

Probability = Annotated[float, Interval(ge=0.0, le=1.0)]


class Bernoulli:
    """Loses the packets of a slot together, with a fixed probability, independently over steps.

    Parameters
    ----------
    loss
        The probability that a slot's packets are lost.
    """

    open_loop: ClassVar[bool] = True

    def __init__(self, placement: Placement, *, loss: Probability) -> None:
        self._label = placement.label
        self._loss = loss
        draws = {name: SteppedDraws(generator) for name, generator in placement.generators.items()}
        self._draws = {link: draws[stream] for link, stream in placement.streams.items()}

    def apply(self, link: str, step: int, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        """Return the packets, or nothing when the slot is lost."""
        if self._draws[link].at(step) >= self._loss:
            return packets
        for packet in packets:
            ledger.lost(link, self._label, packet)
        return ()
