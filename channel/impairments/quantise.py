"""Quantisation: values that are rounded to what a coarse number format can say."""

from __future__ import annotations

from typing import Annotated, ClassVar

from annotated_types import Gt

from channel.contract import Lane, Placement
from channel.impairments.values import ValueFunction, ValueLane

_WHOLE = 2.0**53  # from here on, a number of steps is whole anyway


class Quantise:
    """Rounds every value to the nearest of ``offset + n * step``, ties to even n: a uniform quantiser.

    The error of a value is at most ``step / 2``; where values spread over many steps it is nearly uniform,
    with variance ``step^2 / 12``. A sender's seal covers the rounded values.

    Parameters
    ----------
    step
        The distance of the levels, in the payload's unit.
    offset
        One of the levels.
    """

    open_loop: ClassVar[bool] = True
    acts_as_sender: ClassVar[bool] = True

    def __init__(self, placement: Placement, *, step: Annotated[float, Gt(0.0)], offset: float = 0.0) -> None:
        most = step * _WHOLE

        def rounded(values: list[float]) -> list[float]:
            return [
                offset + step * round((value - offset) / step) if abs(value - offset) < most else value
                for value in values
            ]

        self._placement = placement
        self._function = ValueFunction(placement, rounded)

    def lane(self, link: str) -> Lane:
        """Return what it does on a link."""
        return ValueLane(self._placement, link, self._function)
