"""Covert attack: it moves the plant, and takes out of the measurements what the motion adds to them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from bus.packets import Packet, Vector
from channel.contract import Lane, Ledger, Placement, Slot
from channel.known_model import KnownModel
from channel.shifting import ShiftingLane

_FORGOTTEN = 1e-15


class Covert:
    """Adds ``u_a`` to the input and subtracts ``C x_a`` from the measurements (Smith 2015).

    ``x_a+ = A x_a + B u_a`` is what the added input does to the plant, from ``x_a = 0`` on. The receivers see
    the measurements, and so the residuals, of a plant that was not attacked, to rounding; the plant is off
    by ``x_a``. After the window the measurements are still corrected until ``x_a`` has died away.

    One stage stands on the link from the controller into the plant and on the links of the sensors. It is
    covert towards an estimator if it stands on all links from sensors into it. It does not see what the
    network loses after it: a lost input, or an ``A`` that the plant does not have, shows.

    Parameters
    ----------
    value
        ``u_a``: one number, or one for each component of the input, in its units.

    Raises
    ------
    ValueError
        When there is no link into the plant or none from a sensor, or ``value`` does not fit the input.
    """

    open_loop: ClassVar[bool] = True
    needs: ClassVar[frozenset[str]] = frozenset({"model"})
    needs_control_link: ClassVar[bool] = True

    def __init__(self, placement: Placement, *, value: float | list[float]) -> None:
        self._placement = placement
        self._model = KnownModel(placement.knowledge)
        p = self._model.B.shape[1]
        added = np.asarray(value, dtype=np.float64)
        if added.ndim and added.shape != (p,):
            raise ValueError(f"'value' has {added.size} entries, and the plant's input {p}")
        self._added: Vector = np.broadcast_to(added, (p,)).copy()
        measured = {link for link in placement.streams if self._sensor(link)}
        if not measured or len(measured) == len(placement.streams):
            raise ValueError(
                "a covert attack stands on the controller's link into the plant and on those of sensors; "
                "write 'on: [c1->plant, s*->*]'"
            )

    def lane(self, link: str) -> Lane:
        """Return what it does on the input's link, or on that of a sensor."""
        sensor = self._sensor(link)
        if sensor is None:
            return _InputLane(self._placement, link, self._added)
        model = self._model
        return _MeasurementLane(self._placement, link, model.A, model.B.dot(self._added), model.C((sensor,)))

    def _sensor(self, link: str) -> str | None:
        source = link.partition("->")[0]
        return source if source in self._model.sensors else None


class _InputLane(ShiftingLane):
    def __init__(self, placement: Placement, link: str, added: Vector) -> None:
        super().__init__(placement, link)
        self._added = added

    def act(self, slot: Slot, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        return self.shifted(packets, self._added, ledger)


class _MeasurementLane(ShiftingLane):
    """Follows ``x_a`` (n,) by itself, so that lanes may be called in any order."""

    def __init__(
        self, placement: Placement, link: str, A: np.ndarray, entering: Vector, C: np.ndarray
    ) -> None:
        super().__init__(placement, link)
        self._A = A
        self._C = C
        self._entering = entering
        self._moved: Vector = np.zeros(len(A))
        self._largest = 0.0

    def act(self, slot: Slot, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        packets = self._corrected(packets, ledger)
        self._moved = self._A.dot(self._moved) + self._entering
        return packets

    def rest(self, slot: Slot, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        if self._moved.any():
            packets = self._corrected(packets, ledger)
            self._moved = self._A.dot(self._moved)
        return packets

    def _corrected(self, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        """Take out what this step's ``x_a`` adds; below rounding it is forgotten."""
        size = float(np.linalg.norm(self._moved))
        self._largest = max(self._largest, size)
        if size <= _FORGOTTEN * self._largest:
            self._moved = np.zeros(len(self._A))
        return self.shifted(packets, -self._C.dot(self._moved), ledger)
