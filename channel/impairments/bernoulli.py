"""Independent losses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, ClassVar

from annotated_types import Interval

from bus.packets import Packet
from channel.contract import Lane, Ledger, Placement, Slot
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
        self._placement = placement
        self._loss = loss
        self._draws = placement.by_link(SteppedDraws)

    def lane(self, link: str) -> Lane:
        """Return what it does on a link."""
        return _BernoulliLane(self._placement, link, self._draws[link], self._loss)


class _BernoulliLane(Lane):
    def __init__(self, placement: Placement, link: str, draws: SteppedDraws, loss: float) -> None:
        super().__init__(placement, link)
        self._draw = draws.at
        self._loss = loss

    def act(self, slot: Slot, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        if self._draw(slot.step) >= self._loss:
            return packets
        for packet in packets:
            ledger.lost(self.link, self.label, packet)
        return ()
