"""A false signal that was written beforehand, row by row."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from bus.packets import Vector
from channel.attacks.falsifying import FalsifyingLane, Part
from channel.contract import Lane, Placement, Slot

After = Literal["stop", "hold", "loop"]


class Series:
    """Adds a series of values to the payload, or puts it there instead, a row a step of the window.

    The series goes on in steps in which a schedule inside the window rests.

    Parameters
    ----------
    values
        Rows of one length: one number, or one for each attacked component. The first belongs to the first
        step of the window.
    replace
        Put the values in place of the payload instead of adding them.
    after
        What follows the last row: nothing (``stop``), the last row for good (``hold``), or the first
        (``loop``).
    components
        The indices of the payload that are attacked; all of them when not given.
    """

    open_loop: ClassVar[bool] = True

    def __init__(
        self,
        placement: Placement,
        *,
        values: list[list[float]],
        replace: bool = False,
        after: After = "stop",
        components: list[int] | None = None,
    ) -> None:
        if not values or len({len(row) for row in values}) > 1 or not values[0]:
            raise ValueError("'values' needs at least one row, and all rows of one length")
        self._placement = placement
        row = values[0] if len(values[0]) > 1 else values[0][0]
        self._part = Part(components, values=row)
        self._rows = np.array(values, dtype=np.float64)
        self._replace = replace
        self._after: After = after

    def lane(self, link: str) -> Lane:
        """Return what it does on a link."""
        return _SeriesLane(self._placement, link, self._part, self._rows, self._replace, self._after)


class _SeriesLane(FalsifyingLane):
    cure = "give rows of one value, or of one for each of its 'components'"

    def __init__(
        self,
        placement: Placement,
        link: str,
        part: Part,
        rows: NDArray[np.float64],
        replace: bool,
        after: After,
    ) -> None:
        super().__init__(placement, link, part)
        self._rows, self._replace, self._after = rows, replace, after

    def false(self, slot: Slot, values: Vector) -> Vector | None:
        row = self._row(slot.step - self.placement.first)
        if row is None:
            return None
        return np.broadcast_to(row, values.shape) if self._replace else values + row

    def _row(self, elapsed: int) -> Vector | None:
        if elapsed < len(self._rows):
            return np.asarray(self._rows[elapsed])
        if self._after == "stop":
            return None
        return np.asarray(self._rows[-1 if self._after == "hold" else elapsed % len(self._rows)])
