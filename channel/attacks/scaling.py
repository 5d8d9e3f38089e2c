"""Multiplicative deception: a random share of what a packet says is replaced (Zhou, Zhang, Wang 2020)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from bus.packets import Vector
from channel.attacks.falsifying import FalsifyingLane, Part
from channel.contract import Lane, Placement, Slot
from channel.draws import SteppedVectors


class Scaling:
    """Turns ``y`` into ``(1 - xi) y + xi v``, with ``xi`` uniform on [low, high] for each component and slot.

    With ``xi`` up to 1 the packet is drawn towards ``v``; beyond 1 it is thrown past it (Zhou, Zhang, Wang
    2020, section I).

    Parameters
    ----------
    low
        Lower bound of ``xi``: one number, or one for each attacked component.
    high
        Likewise, the upper bound.
    value
        The ``v``: one number, or one for each attacked component.
    components
        The indices of the payload that are attacked; all of them when not given.
    """

    open_loop: ClassVar[bool] = True

    def __init__(
        self,
        placement: Placement,
        *,
        low: float | list[float],
        high: float | list[float],
        value: float | list[float] = 0.0,
        components: list[int] | None = None,
    ) -> None:
        self._placement = placement
        self._part = Part(components, low=low, high=high, value=value)
        self._low, self._value = np.asarray(low, dtype=np.float64), np.asarray(value, dtype=np.float64)
        try:
            self._width = np.asarray(high, dtype=np.float64) - self._low
        except ValueError as error:
            raise ValueError(f"'low' {low} and 'high' {high} have different lengths") from error
        if np.any(self._width < 0.0):
            raise ValueError(f"'low' {low} is above 'high' {high}; exchange them")
        self._draws = placement.by_link(SteppedVectors)

    def lane(self, link: str) -> Lane:
        """Return what it does on a link."""
        return _ScalingLane(
            self._placement, link, self._part, self._draws[link], self._low, self._width, self._value
        )


class _ScalingLane(FalsifyingLane):
    cure = "give one 'low', 'high' and 'value', or one for each of its 'components'"

    def __init__(
        self,
        placement: Placement,
        link: str,
        part: Part,
        draws: SteppedVectors,
        low: Vector,
        width: Vector,
        value: Vector,
    ) -> None:
        super().__init__(placement, link, part)
        self._draw = draws.at
        self._low, self._width, self._value = low, width, value

    def false(self, slot: Slot, values: Vector) -> Vector:
        xi = self._low + self._width * self._draw(slot.number, values.size)
        return (1.0 - xi) * values + xi * self._value
