"""A constant instead of what a packet says: a stuck or a silenced sensor."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from bus.packets import Vector
from channel.attacks.falsifying import StatedValue, ValueLane
from channel.contract import Slot


class _ConstantLane(ValueLane):
    def false(self, slot: Slot, values: Vector) -> Vector:
        return np.broadcast_to(self.value, values.shape)

    def added(self, slot: Slot, values: Vector) -> Vector:
        return self.value - values


class Constant(StatedValue):
    """Puts ``value`` in place of the payload of every packet.

    Parameters
    ----------
    value
        One number, or one for each attacked component.
    components
        The indices of the payload that are attacked; all of them when not given.
    """

    lane_kind: ClassVar[type[ValueLane]] = _ConstantLane
