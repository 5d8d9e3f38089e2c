"""Outages at known times: a link that is down."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, ClassVar

from annotated_types import Ge, Len

from bus.packets import Packet
from channel.contract import NEVER, Lane, Ledger, Placement, Slot

Steps = Annotated[int, Ge(0)]


class Outage:
    """Loses everything in windows of steps.

    Parameters
    ----------
    windows
        ``[first, last]`` of each window in steps, both inclusive.
    """

    open_loop: ClassVar[bool] = True

    def __init__(
        self,
        placement: Placement,
        *,
        windows: Annotated[list[Annotated[list[Steps], Len(2, 2)]], Len(1)],
    ) -> None:
        for first, last in windows:
            if last < first:
                raise ValueError(f"the window [{first}, {last}] runs backwards; write [{last}, {first}]")
        self._placement = placement
        self._windows = tuple((first, last) for first, last in windows)

    def lane(self, link: str) -> Lane:
        """Return what it does on a link."""
        return _OutageLane(self._placement, link, self._windows)


class _OutageLane(Lane):
    def __init__(self, placement: Placement, link: str, windows: Sequence[tuple[int, int]]) -> None:
        super().__init__(placement, link)
        self._windows = windows

    def act(self, slot: Slot, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        step = slot.step
        for first, last in self._windows:
            if first <= step <= last:
                for packet in packets:
                    ledger.lost(self.link, self.label, packet)
                return ()
        return packets

    def quiet_until(self, step: int) -> int:
        return min((max(first, step) for first, last in self._windows if step <= last), default=NEVER)
