"""Additive deception: the adversary adds a constant to what a packet says."""

from __future__ import annotations

from typing import ClassVar

from bus.packets import Vector
from channel.attacks.falsifying import StatedValue, ValueLane
from channel.contract import Slot


class _BiasLane(ValueLane):
    def false(self, slot: Slot, values: Vector) -> Vector:
        return values + self.value

    def added(self, slot: Slot, values: Vector) -> Vector:
        return self.value


class Bias(StatedValue):
    """Adds ``value`` to the payload of every packet (the n_i of Ding et al. 2021, section II).

    Parameters
    ----------
    value
        One number, or one for each attacked component.
    components
        The indices of the payload that are attacked; all of them when not given.
    """

    lane_kind: ClassVar[type[ValueLane]] = _BiasLane
