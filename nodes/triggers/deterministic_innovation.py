"""Send what differs enough from its prediction."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from annotated_types import Gt

from bus.packets import Vector
from nodes.lapack import dtrtrs
from nodes.triggers.contract import BoxSilence, TriggerSetting
from nodes.triggers.prediction import prediction_of


class DeterministicInnovation:
    """Sends when ``max |L^-1 z| > threshold``, ``z = y - C x^-`` and ``L L' = S = C P^- C' + R`` (Wu 2013).

    ``x^-`` and ``P^-`` are those of a filter that only knows what this sensor has sent and when it was
    silent; the sender runs it, and so may a receiver, as `EventTriggeredKalman` does. Given silence the state
    is not Gaussian; the filter takes the Gaussian of the same mean and covariance, as the paper does. An
    `Innovation` sensor sends innovations of its own filter: those are compared with their covariance.

    The share of slots used is near ``1 - (1 - 2 Q(threshold))^m``, Q the upper tail of the normal law.

    Parameters
    ----------
    setting
        That of a linear sensor on a linear plant without input.
    threshold
        Bound on the whitened innovation (standard deviations).

    Raises
    ------
    ValueError
        When the sender is no such sensor.
    """

    def __init__(self, setting: TriggerSetting, *, threshold: Annotated[float, Gt(0.0)]) -> None:
        self._prediction = prediction_of(setting)
        self._threshold = threshold

    def sends(self, step: int, values: Vector, reference: Vector | None = None) -> bool:
        """Return whether the value (m,) is surprising enough."""
        silence = self.silence(step)
        whitened = dtrtrs(silence.factor, values - silence.centre, lower=1)[0]
        sent = float(np.abs(whitened).max()) > self._threshold
        self._prediction.note(step, values if sent else None, silence)
        return sent

    def silence(self, step: int) -> BoxSilence:
        """Return the box around the prediction in which the value lies when it is not sent."""
        return BoxSilence(*self._prediction.at(step), self._threshold)

    def note(self, step: int, values: Vector | None) -> None:
        """Take what was sent (m,), None for a quiet slot."""
        self._prediction.note(step, values, self.silence(step))
