"""Additive deception: the adversary adds a constant to what a packet says."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from msgspec.structs import replace

from bus.packets import Packet
from channel.contract import Ledger, Placement


class Bias:
    """Adds ``value`` to the payload of every packet (the n_i of Ding et al. 2021, section II).

    Parameters
    ----------
    value
        One number, or one for each attacked component.
    components
        The indices of the payload that are attacked; all of them when not given.
    """

    open_loop: ClassVar[bool] = True

    def __init__(
        self, placement: Placement, *, value: float | list[float], components: list[int] | None = None
    ) -> None:
        if components is not None and isinstance(value, list) and len(value) != len(components):
            raise ValueError(f"'value' has {len(value)} entries for {len(components)} components")
        self._label = placement.label
        self._value = np.asarray(value, dtype=np.float64)
        self._components = slice(None) if components is None else np.array(components, dtype=np.intp)

    def apply(self, link: str, step: int, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        """Return the falsified packets; raises ValueError when the bias does not fit the payload."""
        return [self._falsify(link, packet, ledger) for packet in packets]

    def _falsify(self, link: str, packet: Packet, ledger: Ledger) -> Packet:
        values = packet.values.copy()
        try:
            values[self._components] += self._value
        except (ValueError, IndexError) as error:
            raise ValueError(
                f"the bias on {link} does not fit a payload of {values.size} values; "
                "give one 'value', or one for each of its 'components'"
            ) from error
        ledger.attacked(link, self._label, packet, float(np.linalg.norm(values - packet.values)))
        return replace(packet, values=values)
