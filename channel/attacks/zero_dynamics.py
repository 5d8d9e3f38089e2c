"""Zero-dynamics attack: an input that drives the plant away while its outputs stay where they were."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Gt

from bus.packets import Packet, Vector
from channel.contract import Lane, Ledger, Placement, Slot
from channel.invariant_zeros import InvariantZero, invariant_zeros
from channel.known_model import KnownModel
from channel.shifting import ShiftingLane

_LARGEST = 1e12


class ZeroDynamics:
    """Adds ``eps z0^j u0`` to the input, in the j-th step of its window (Teixeira et al. 2015).

    ``(z0, x0, u0)`` is a finite invariant zero of the plant: ``A x0 + B u0 = z0 x0`` and ``C x0 = 0`` with
    ``|x0| = 1``. The input moves the state by ``eps (z0^j x0 - A^j x0)``. Of that the outputs show
    ``-eps C A^j x0``: the plant did not start on ``eps x0``. A zero outside the unit circle lets the state
    grow as ``eps |z0|^j``; what the outputs show does not grow if the loop is stable, and is as small as
    ``eps``. Of a pair of complex zeros the real part is taken.

    The attack stands on the link from the controller into the plant. It is a function of the step: a
    ``when`` that pauses it, or a lost input, breaks the motion and shows.

    Parameters
    ----------
    amplitude
        ``eps``, in units of the state.
    sensors
        The sensors whose outputs stay quiet; all of them when not given.
    zero
        The zero to be used, as its real and, if any, its imaginary part; without it the one of the largest
        modulus.

    Raises
    ------
    ValueError
        When the plant has no such zero, or the input would grow beyond 1e12 in the window.
    """

    open_loop: ClassVar[bool] = True
    needs: ClassVar[frozenset[str]] = frozenset({"model"})
    needs_control_link: ClassVar[bool] = True

    def __init__(
        self,
        placement: Placement,
        *,
        amplitude: Annotated[float, Gt(0.0)],
        sensors: list[str] | None = None,
        zero: list[float] | None = None,
    ) -> None:
        model = KnownModel(placement.knowledge)
        zeros = invariant_zeros(model.A, model.B, model.C(sensors or model.sensors))
        self.zero = _chosen(zeros, zero)
        self.amplitude = amplitude
        growth = (placement.last - placement.first) * np.log(abs(self.zero.z)) if self.zero.z else 0.0
        if np.log(amplitude) + growth > np.log(_LARGEST):
            raise ValueError(
                f"the zero {_written(self.zero.z)} would let the attack grow beyond {_LARGEST:g} in steps "
                f"{placement.first} to {placement.last}; end its window earlier"
            )
        self._placement = placement

    def lane(self, link: str) -> Lane:
        """Return what it does on a link into the plant."""
        return _ZeroDynamicsLane(self._placement, link, self)

    def input(self, since: int) -> Vector:
        """Return what is added to the input (p,), ``since`` steps after the first of the window."""
        added: Vector = self.amplitude * np.real(self.zero.z**since * self.zero.u)
        return added


class _ZeroDynamicsLane(ShiftingLane):
    def __init__(self, placement: Placement, link: str, attack: ZeroDynamics) -> None:
        super().__init__(placement, link)
        self._attack = attack

    def act(self, slot: Slot, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        return self.shifted(packets, self._attack.input(slot.step - self.placement.first), ledger)


def _chosen(zeros: Sequence[InvariantZero], wanted: Sequence[float] | None) -> InvariantZero:
    """Return the zero that is wanted, or the first; raises ValueError when there is none."""
    listed = ", ".join(_written(zero.z) for zero in zeros) or "none"
    if not zeros:
        raise ValueError("the plant has no finite invariant zero for these sensors; no input stays hidden")
    if wanted is None:
        return zeros[0]
    if len(wanted) not in (1, 2):
        raise ValueError(f"a zero is one number or two, real and imaginary part; there is: {listed}")
    point = complex(wanted[0], abs(wanted[1]) if len(wanted) == 2 else 0.0)
    nearest = min(zeros, key=lambda zero: abs(zero.z - point))
    if abs(nearest.z - point) > 1e-3 * max(1.0, abs(point)):
        raise ValueError(f"{_written(point)} is no invariant zero; there is: {listed}")
    return nearest


def _written(z: complex) -> str:
    return f"{z.real:.6g}" if abs(z.imag) < 1e-12 else f"[{z.real:.6g}, {z.imag:.6g}]"
