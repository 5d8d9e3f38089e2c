"""Sets of packets of which at most one is genuine, and what is believed of the fakes among them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bus.packets import Packet


@dataclass(frozen=True)
class FakeBox:
    """Fakes are believed uniform between ``low`` and ``high``: one number, or one for each output."""

    low: float | list[float]
    high: float | list[float]

    def log_density(self, outputs: int) -> float:
        """Return ``log kappa`` for a measurement of ``outputs`` components; raises ValueError for no box."""
        low, high = np.asarray(self.low, dtype=np.float64), np.asarray(self.high, dtype=np.float64)
        for bound in (low, high):
            if bound.ndim and bound.size != outputs:
                raise ValueError(
                    f"the box of 'fakes' has {bound.size} components, a sensor {outputs}; give one number, "
                    "or one for each output"
                )
        widths = np.broadcast_to(high - low, (outputs,))
        if not np.all((widths > 0.0) & np.isfinite(widths)):
            raise ValueError("the box of 'fakes' is empty; give 'low' below 'high'")
        return -float(np.log(widths).sum())


def packet_sets(step: int, packets: Sequence[Packet], sizes: Mapping[str, int]) -> dict[str, list[Packet]]:
    """Return the packets that measure the state of ``step``, by sensor in the sensors' order.

    It leaves out packets of earlier steps, of another size than the sensor's (``sizes``), and copies: equal
    values count once, for a set holds nothing twice.
    """
    found: dict[str, dict[bytes, Packet]] = {}
    for packet in packets:
        if packet.sent_step == step and packet.values.size == sizes.get(packet.source):
            found.setdefault(packet.source, {}).setdefault(packet.values.tobytes(), packet)
    return {source: list(found[source].values()) for source in sizes if source in found}
