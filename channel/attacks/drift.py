"""A ramp: the adversary's error grows step by step, slowly enough to pass for the plant."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from bus.packets import Vector
from channel.attacks.falsifying import FalsifyingLane, Part
from channel.contract import Lane, Placement, Slot


class Drift:
    """Adds ``rate (k - k0 + 1)`` to the payload in step k of a window that begins in step k0.

    The ramp goes on in steps in which a schedule inside the window rests.

    Parameters
    ----------
    rate
        Growth a step, in the payload's unit: one number, or one for each attacked component.
    components
        The indices of the payload that are attacked; all of them when not given.
    """

    open_loop: ClassVar[bool] = True
    reveals: ClassVar[bool] = True

    def __init__(
        self, placement: Placement, *, rate: float | list[float], components: list[int] | None = None
    ) -> None:
        self._placement = placement
        self._part = Part(components, rate=rate)
        self._rate = np.asarray(rate, dtype=np.float64)

    def lane(self, link: str) -> Lane:
        """Return what it does on a link."""
        return _DriftLane(self._placement, link, self._part, self._rate)


class _DriftLane(FalsifyingLane):
    cure = "give one 'rate', or one for each of its 'components'"

    def __init__(self, placement: Placement, link: str, part: Part, rate: Vector) -> None:
        super().__init__(placement, link, part)
        self._rate = rate
        self._before = placement.first - 1

    def false(self, slot: Slot, values: Vector) -> Vector:
        return values + self.added(slot, values)

    def added(self, slot: Slot, values: Vector) -> Vector:
        return (slot.step - self._before) * self._rate
