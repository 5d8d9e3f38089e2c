"""Intermittent false data whose size creeps up on its target (Sadeghzadeh-Nokhodberiz et al. 2022)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Interval

from bus.packets import Packet, Vector
from bus.quantities import Probability
from channel.attacks.falsifying import FalsifyingLane, Part
from channel.contract import Lane, Ledger, Placement, Slot
from channel.draws import SteppedDraws


class ConvergingBias:
    """Adds ``l_k gamma_k`` to the payload, with ``gamma`` on its way to ``target``.

    ``gamma_{k+1} = pole gamma_k + (1 - pole) target``, with gamma 0 in the first step of the window, whether
    the attack occurs or not; ``l_k`` is 1 with one probability, independently over steps (Sadeghzadeh-
    Nokhodberiz, Meskin, Hasanzadeh 2022, section II and V).

    Parameters
    ----------
    target
        What gamma converges to: one number, or one for each attacked component.
    pole
        How slowly: the share of the distance that is left after a step.
    probability
        The probability that the attack occurs in a step.
    components
        The indices of the payload that are attacked; all of them when not given.
    """

    open_loop: ClassVar[bool] = True
    reveals: ClassVar[bool] = True

    def __init__(
        self,
        placement: Placement,
        *,
        target: float | list[float],
        pole: Annotated[float, Interval(ge=0.0, lt=1.0)] = 0.9,
        probability: Probability = 0.5,
        components: list[int] | None = None,
    ) -> None:
        self._placement = placement
        self._part = Part(components, target=target)
        self._probability = probability
        self._path = _Path(np.asarray(target, dtype=np.float64), pole)
        self._draws = placement.by_link(SteppedDraws)

    def lane(self, link: str) -> Lane:
        """Return what it does on a link."""
        return _ConvergingLane(
            self._placement, link, self._part, self._path, self._draws[link], self._probability
        )


class _Path:
    """The values of gamma, a step of the window an entry."""

    def __init__(self, target: Vector, pole: float) -> None:
        self._target, self._pole = target, pole
        self._gamma: list[Vector] = [np.zeros_like(target)]

    def at(self, elapsed: int) -> Vector:
        while elapsed >= len(self._gamma):
            self._gamma.append(self._pole * self._gamma[-1] + (1.0 - self._pole) * self._target)
        return self._gamma[elapsed]


class _ConvergingLane(FalsifyingLane):
    cure = "give one 'target', or one for each of its 'components'"

    def __init__(
        self,
        placement: Placement,
        link: str,
        part: Part,
        path: _Path,
        draws: SteppedDraws,
        probability: float,
    ) -> None:
        super().__init__(placement, link, part)
        self._gamma = path.at
        self._draw = draws.at
        self._probability = probability

    def act(self, slot: Slot, packets: Sequence[Packet], ledger: Ledger) -> Sequence[Packet]:
        if self._draw(slot.step) >= self._probability:
            return packets
        return super().act(slot, packets, ledger)

    def false(self, slot: Slot, values: Vector) -> Vector:
        return values + self.added(slot, values)

    def added(self, slot: Slot, values: Vector) -> Vector:
        return self._gamma(slot.step - self.placement.first)
