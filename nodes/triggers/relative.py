"""Send what has changed enough in comparison with a reference."""

from __future__ import annotations

from typing import Annotated

from annotated_types import Ge, MinLen

from bus.packets import Vector
from nodes.contract import Matrix
from nodes.triggers.comparing import compared, sized, weight_matrix
from nodes.triggers.contract import TriggerSetting


class Relative:
    """Sends when ``f' Phi f > sigma Psi' Phi Psi`` with ``f = z - z_last``, and the first value always.

    ``Psi`` (m,) is the sender's to give. A distributed filter gives what its neighbours' last sent values
    differ from its own by (Zhou 2020, (8)). A sensor, and a method that gives none, are compared with their
    own current value, ``Psi = z`` (Yue, Tian, Han 2013): the change counts in proportion to what is measured,
    so the threshold falls with the signal, and near zero nearly everything is sent.

    Parameters
    ----------
    setting
        The sender's.
    sigma
        The threshold of the comparison; 0 sends every change.
    Phi
        Weight (m, m), positive definite; one number stands for a multiple of the unit.
    components
        The components of what is sent that count, where no reference is given; without it all.
    """

    def __init__(
        self,
        setting: TriggerSetting,
        *,
        sigma: Annotated[float, Ge(0.0)],
        Phi: float | list[list[float]] = 1.0,
        components: Annotated[list[Annotated[int, Ge(0)]], MinLen(1)] | None = None,
    ) -> None:
        self.sigma = sigma
        self._weight = weight_matrix(Phi, "Phi")
        self._components = components
        self._last: Vector | None = None

    def sends(self, step: int, values: Vector, reference: Vector | None = None) -> bool:
        """Return whether the values (m,) have changed enough in comparison with the reference (m,)."""
        value = values if reference is not None else compared(values, self._components)
        if self._last is not None:
            change = value - self._last
            if self._square(change) <= self.bound(value if reference is None else reference):
                return False
        self._last = value
        return True

    def bound(self, reference: Vector) -> float:
        """Return ``sigma Psi' Phi Psi``: what the weighted square of the change stays below in silence."""
        return self.sigma * self._square(reference)

    def weight(self, size: int) -> Matrix:
        """Return ``Phi`` (size, size)."""
        return sized(self._weight, size, "Phi")

    def _square(self, vector: Vector) -> float:
        if isinstance(self._weight, float):
            return self._weight * float(vector.dot(vector))
        return float(vector.dot(self.weight(vector.size)).dot(vector))
