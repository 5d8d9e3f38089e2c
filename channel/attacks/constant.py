"""A constant instead of what a packet says: a stuck or a silenced sensor."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from bus.packets import Vector
from channel.attacks.falsifying import FalsifyingLane, Part
from channel.contract import Lane, Placement, Slot


class Constant:
    """Puts ``value`` in place of the payload of every packet.

    Parameters
    ----------
    value
        One number, or one for each attacked component.
    components
        The indices of the payload that are attacked; all of them when not given.
    """

    open_loop: ClassVar[bool] = True
    reveals: ClassVar[bool] = True

    def __init__(
        self, placement: Placement, *, value: float | list[float], components: list[int] | None = None
    ) -> None:
        self._placement = placement
        self._part = Part(components, value=value)
        self._value = np.asarray(value, dtype=np.float64)

    def lane(self, link: str) -> Lane:
        """Return what it does on a link."""
        return _ConstantLane(self._placement, link, self._part, self._value)


class _ConstantLane(FalsifyingLane):
    def __init__(self, placement: Placement, link: str, part: Part, value: Vector) -> None:
        super().__init__(placement, link, part)
        self._value = value

    def false(self, slot: Slot, values: Vector) -> Vector:
        return np.broadcast_to(self._value, values.shape)

    def added(self, slot: Slot, values: Vector) -> Vector:
        return self._value - values
