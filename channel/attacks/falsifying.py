"""What all attacks share that change what packets say."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from bus.packets import Packet, Vector
from channel.contract import Lane, Ledger, Placement, Slot, distance


class Part:
    """The attacked part of a payload: the components named, or all of them.

    Parameters
    ----------
    components
        Indices of the payload, from 0; None for all of them.
    values
        Parameters by name, each one number or one for each component.

    Raises
    ------
    ValueError
        When a parameter has another number of entries than there are components, or an index is negative or
        stands there twice.
    """

    def __init__(self, components: list[int] | None, **values: float | list[float]) -> None:
        if components is not None and (
            min(components, default=0) < 0 or len({*components}) < len(components)
        ):
            raise ValueError(f"'components' {components} must be different indices, from 0")
        for name, value in values.items():
            if components is not None and isinstance(value, list) and len(value) != len(components):
                raise ValueError(f"'{name}' has {len(value)} entries for {len(components)} components")
        self.index: slice | NDArray[np.intp] = (
            slice(None) if components is None else np.array(components, dtype=np.intp)
        )
        self._size = None if components is None else len(components)

    def size(self, payload: Vector) -> int:
        """Return the number of attacked components of a payload."""
        return payload.size if self._size is None else self._size


class FalsifyingLane(Lane):
    """A lane that changes the values of packets one by one and leaves their headers as they are."""

    cure = "give one 'value', or one for each of its 'components'"
    may_resize = False
    """Whether what it says instead of a whole payload may have another size."""

    def __init__(self, placement: Placement, link: str, part: Part) -> None:
        super().__init__(placement, link)
        self.part = part

    def false(self, slot: Slot, values: Vector) -> Vector | None:
        """Return what the attacked part of a payload says instead of ``values``, None for no change."""
        raise NotImplementedError

    def added(self, slot: Slot, values: Vector) -> Vector | None:
        """Return what is added to ``values``, those of the attacked part; None when that cannot be told."""
        return None

    def reveal(self, slot: Slot, values: Vector) -> Vector | None:
        """Return what is added to a payload, nothing where it is not attacked."""
        index = self.part.index
        try:
            added = self.added(slot, values[index])
            if added is None:
                return None
            whole = np.zeros_like(values)
            whole[index] = added
        except (ValueError, IndexError) as error:
            raise self._misfit(values) from error
        return whole

    def _misfit(self, values: Vector) -> ValueError:
        return ValueError(
            f"{self.label} on {self.link} does not fit a payload of {values.size} values; {self.cure}"
        )

    def act(self, slot: Slot, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        """Falsify each packet of a slot; a packet whose values stay the same was not attacked."""
        changed = [self._falsified(slot, packet, ledger) for packet in packets]
        return packets if all(map(_is, changed, packets)) else changed

    def _falsified(self, slot: Slot, packet: Packet, ledger: Ledger) -> Packet:
        values = packet.values.copy()
        index = self.part.index
        try:
            false = self.false(slot, values[index])
            if false is not None and self.may_resize and isinstance(index, slice):
                values = false
            elif false is not None:
                values[index] = false
        except (ValueError, IndexError) as error:
            raise self._misfit(values) from error
        magnitude = distance(values, packet.values)
        if magnitude == 0.0:
            return packet
        ledger.attacked(self.link, self.label, packet, magnitude)
        return self.placement.forged(packet, values)


class ValueLane(FalsifyingLane):
    """A lane that makes use of one stated value."""

    def __init__(self, placement: Placement, link: str, part: Part, value: Vector) -> None:
        super().__init__(placement, link, part)
        self.value = value


class StatedValue:
    """What attacks share that do the same to every packet, with one ``value``: their lane says what."""

    open_loop: ClassVar[bool] = True
    reveals: ClassVar[bool] = True
    lane_kind: ClassVar[type[ValueLane]]

    def __init__(
        self, placement: Placement, *, value: float | list[float], components: list[int] | None = None
    ) -> None:
        self._placement = placement
        self._part = Part(components, value=value)
        self._value = np.asarray(value, dtype=np.float64)

    def lane(self, link: str) -> Lane:
        """Return what it does on a link."""
        return self.lane_kind(self._placement, link, self._part, self._value)


def _is(one: object, other: object) -> bool:
    return one is other
