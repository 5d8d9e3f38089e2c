"""Additive deception: the adversary adds a constant to what a packet says."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from bus.packets import Packet, Vector
from channel.contract import Lane, Ledger, Placement, Slot


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
        self._placement = placement
        self._value = np.asarray(value, dtype=np.float64)
        self._components = slice(None) if components is None else np.array(components, dtype=np.intp)

    def lane(self, link: str) -> Lane:
        """Return what it does on a link."""
        return _BiasLane(self._placement, link, self._value, self._components)


class _BiasLane(Lane):
    def __init__(
        self, placement: Placement, link: str, value: Vector, components: slice | NDArray[np.intp]
    ) -> None:
        super().__init__(placement, link)
        self._value = value
        self._components = components

    def act(self, slot: Slot, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        return [self._falsify(packet, ledger) for packet in packets]

    def _falsify(self, packet: Packet, ledger: Ledger) -> Packet:
        values = packet.values.copy()
        try:
            values[self._components] += self._value
        except (ValueError, IndexError) as error:
            raise ValueError(
                f"the bias on {self.link} does not fit a payload of {values.size} values; "
                "give one 'value', or one for each of its 'components'"
            ) from error
        ledger.attacked(self.link, self.label, packet, float(np.linalg.norm(values - packet.values)))
        return self.placement.forged(packet, values)
