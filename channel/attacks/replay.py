"""Replay: what was overheard earlier is played again in place of what is sent now."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import zip_longest
from typing import ClassVar

from bus.packets import Packet
from channel.contract import Lane, Ledger, Placement, Slot, distance


class Replay:
    """Captures the slots of some steps, and plays them from the window's beginning on, again and again.

    A slot that was empty when it was captured is played as an empty one: what was sent is lost.

    Parameters
    ----------
    capture
        First and last step of the captured ones, both included; before the attack's own window.
    rewrite
        Give what is replayed the headers of packets sent now, sealed as the adversary can. Without it the
        packets come as they were captured: their seals fit, and their headers tell their age.
    """

    open_loop: ClassVar[bool] = False

    def __init__(self, placement: Placement, *, capture: list[int], rewrite: bool = True) -> None:
        if len(capture) != 2 or not 0 <= capture[0] <= capture[1]:
            raise ValueError(f"'capture' {capture} must be [first, last], both inclusive")
        if capture[1] >= placement.first:
            raise ValueError(
                f"'capture' {capture} must end before the attack's window, which begins in step "
                f"{placement.first}; give the attack later 'steps'"
            )
        self._placement = placement
        self._capture = capture[0], capture[1]
        self._rewrite = rewrite

    def lane(self, link: str) -> Lane:
        """Return what it does on a link."""
        return _ReplayLane(self._placement, link, self._capture, self._rewrite)


class _ReplayLane(Lane):
    def __init__(self, placement: Placement, link: str, capture: tuple[int, int], rewrite: bool) -> None:
        super().__init__(placement, link)
        self._first, self._last = capture
        self._rewrite = rewrite
        self._tape: list[Sequence[Packet]] = []
        self._played = 0

    def rest(self, slot: Slot, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        if self._first <= slot.step <= self._last:
            self._tape.append(packets)
        return packets

    def act(self, slot: Slot, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        captured = self._tape[self._played % len(self._tape)]
        self._played += 1
        played = []
        for old, genuine in zip_longest(captured, packets):
            if old is None:
                ledger.lost(self.link, self.label, genuine)
                continue
            packet = self._rewritten(old, genuine, slot) if self._rewrite else old
            if genuine is None:
                ledger.injected(self.link, self.label, packet)
            else:
                magnitude = distance(packet.values, genuine.values)
                ledger.attacked(self.link, self.label, packet, magnitude)
            played.append(packet)
        return played

    def _rewritten(self, old: Packet, genuine: Packet | None, slot: Slot) -> Packet:
        header = old if genuine is None else genuine
        sequence = slot.number if genuine is None else genuine.sequence
        return self.placement.forged(header, old.values, sent_step=slot.step, sequence=sequence)
