"""Send what has changed enough since it was last sent."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, MinLen

from bus.packets import Vector
from nodes.triggers.comparing import compared
from nodes.triggers.contract import BoxSilence, TriggerSetting


class SendOnDelta:
    """Sends when ``|y - y_last| > threshold`` (Miskowicz 2006), and the first value always.

    Silence tells a receiver that the value is near the last one sent: `silence` says so for one component or
    the ``largest`` norm.

    Parameters
    ----------
    setting
        The sender's.
    threshold
        Bound on the norm of the change, in the unit of what is sent.
    norm
        ``euclidean`` over the components, or the ``largest`` magnitude among them.
    components
        The components of what is sent that count; without it all.
    """

    def __init__(
        self,
        setting: TriggerSetting,
        *,
        threshold: Annotated[float, Gt(0.0)],
        norm: Literal["euclidean", "largest"] = "euclidean",
        components: Annotated[list[Annotated[int, Ge(0)]], MinLen(1)] | None = None,
    ) -> None:
        self._threshold = threshold
        self._order = 2 if norm == "euclidean" else np.inf
        self._components = components
        self._last: Vector | None = None

    def sends(self, step: int, values: Vector, reference: Vector | None = None) -> bool:
        """Return whether the values (m,) have changed enough."""
        sent = True
        if self._last is not None:
            change = compared(values - self._last, self._components)
            sent = float(np.linalg.norm(change, self._order)) > self._threshold
        self.note(step, values if sent else None)
        return sent

    def silence(self, step: int) -> BoxSilence | None:
        """Return the box around the last value sent, where silence means one."""
        if self._last is None or self._components is not None:
            return None
        if self._order == 2 and self._last.size > 1:
            return None
        return BoxSilence(self._last, np.eye(self._last.size), self._threshold)

    def note(self, step: int, values: Vector | None) -> None:
        """Take what was sent (m,), None for a quiet slot."""
        if values is not None:
            self._last = values
