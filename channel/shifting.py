"""Lanes that add a vector to what packets say."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bus.packets import Packet, Vector
from channel.contract import Lane, Ledger


class ShiftingLane(Lane):
    """A lane that can shift the payloads of a slot."""

    def shifted(self, packets: Sequence[Packet], shift: Vector, ledger: Ledger) -> Sequence[Packet]:
        """Return false packets, with ``shift`` (m,) added to each; raises ValueError on another size."""
        if not packets or not shift.any():
            return packets
        for packet in packets:
            if packet.values.shape != shift.shape:
                raise ValueError(
                    f"{self.label} shifts {shift.size} values, and a payload on {self.link} has "
                    f"{packet.values.size}; see that it stands on the links that it is meant for"
                )
        magnitude = float(np.linalg.norm(shift))
        false = []
        for packet in packets:
            ledger.attacked(self.link, self.label, packet, magnitude)
            false.append(self.placement.forged(packet, packet.values + shift))
        return false
