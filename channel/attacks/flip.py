"""Flipped signs, or flipped bits of a binary output."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from bus.packets import Packet, Vector
from bus.quantities import Probability
from channel.attacks.falsifying import FalsifyingLane, Part
from channel.contract import Lane, Ledger, Placement, Slot
from channel.draws import SteppedDraws


class Flip:
    """Turns ``y`` into ``-y``, or a binary output ``y`` into ``1 - y``.

    Parameters
    ----------
    components
        The indices of the payload that are flipped; all of them when not given.
    binary
        Whether the payload is 0 or 1: ``1 - y`` instead of ``-y``.
    probability
        The probability that a slot is attacked, independently over slots; its packets share their fate.
    """

    open_loop: ClassVar[bool] = True

    def __init__(
        self,
        placement: Placement,
        *,
        components: list[int] | None = None,
        binary: bool = False,
        probability: Probability = 1.0,
    ) -> None:
        self._placement = placement
        self._part = Part(components)
        self._binary = binary
        self._probability = probability
        self._draws = placement.by_link(SteppedDraws)

    def lane(self, link: str) -> Lane:
        """Return what it does on a link."""
        return _FlipLane(
            self._placement, link, self._part, self._draws[link], self._binary, self._probability
        )


class _FlipLane(FalsifyingLane):
    cure = "name 'components' that it has"

    def __init__(
        self,
        placement: Placement,
        link: str,
        part: Part,
        draws: SteppedDraws,
        binary: bool,
        probability: float,
    ) -> None:
        super().__init__(placement, link, part)
        self._draw = draws.at
        self._binary = binary
        self._probability = probability

    def act(self, slot: Slot, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        if self._draw(slot.number) >= self._probability:
            return packets
        return super().act(slot, packets, ledger)

    def false(self, slot: Slot, values: Vector) -> Vector:
        return 1.0 - values if self._binary else -values
