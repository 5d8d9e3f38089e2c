"""Send every so many steps: what event triggers are measured against."""

from __future__ import annotations

from typing import Annotated

from annotated_types import Ge

from bus.packets import Vector
from nodes.triggers.contract import TriggerSetting


class Periodic:
    """Sends in every n-th step, whatever is to be sent.

    Parameters
    ----------
    setting
        The sender's.
    every
        Length of the period (steps).
    phase
        The step of each period in which it sends.
    """

    def __init__(
        self, setting: TriggerSetting, *, every: Annotated[int, Ge(1)], phase: Annotated[int, Ge(0)] = 0
    ) -> None:
        if phase >= every:
            raise ValueError(f"phase {phase} is not within the period of {every} steps")
        self._every, self._phase = every, phase

    def sends(self, step: int, values: Vector, reference: Vector | None = None) -> bool:
        """Return whether this is a step of sending."""
        return step % self._every == self._phase
