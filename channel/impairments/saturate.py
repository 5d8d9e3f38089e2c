"""Saturation: values that leave the range of what can be said."""

from __future__ import annotations

import math
from typing import ClassVar

from channel.contract import Lane, Placement
from channel.impairments.values import ValueFunction, ValueLane


class Saturate:
    """Moves every value that leaves a range to the end of the range. A sender's seal covers what is left.

    Parameters
    ----------
    low
        The lower end of the range, in the payload's unit; without it, the range has none.
    high
        Likewise, the upper end.
    """

    open_loop: ClassVar[bool] = True
    acts_as_sender: ClassVar[bool] = True

    def __init__(self, placement: Placement, *, low: float | None = None, high: float | None = None) -> None:
        if low is None and high is None:
            raise ValueError("a range without ends saturates nothing; give 'low' or 'high' or both")
        if low is not None and high is not None and low > high:
            raise ValueError(f"low {low:g} is above high {high:g}; exchange them")

        least = -math.inf if low is None else low
        most = math.inf if high is None else high

        def clipped(values: list[float]) -> list[float]:
            if not values or (min(values) >= least and max(values) <= most):
                return values
            return [min(max(value, least), most) for value in values]

        self._placement = placement
        self._function = ValueFunction(placement, clipped)

    def lane(self, link: str) -> Lane:
        """Return what it does on a link."""
        return ValueLane(self._placement, link, self._function)
