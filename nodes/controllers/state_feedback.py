"""Linear feedback of the estimated state."""

from __future__ import annotations

import numpy as np

from bus.packets import Vector
from nodes.contract import ControllerSetting, Matrix
from nodes.gaussian import Gaussian
from nodes.linear_algebra import square_root


class StateFeedback:
    """The input ``u = -K (x^ - r) + w``; without an estimate it is ``w`` alone.

    ``w ~ N(0, W)`` is a physical watermark (Mo, Weerakkody, Sinopoli 2015): white noise that only the
    controller knows, and whose trace a genuine measurement bears. It is drawn anew in every step, from the
    controller's own stream.

    Parameters
    ----------
    setting
        The node's model of the plant, which must have an input matrix ``B`` (n, p).
    gain
        ``K`` (p, n), in units of the input over units of the state.
    reference
        The state ``r`` (n,) to be held; the origin when not given.
    watermark
        Law of ``w``, in units of the input; its mean must be zero. None for no watermark.

    Raises
    ------
    ValueError
        When the plant has no input, a shape does not fit it, or the watermark has a mean.
    """

    def __init__(
        self,
        setting: ControllerSetting,
        *,
        gain: list[list[float]],
        reference: list[float] | None = None,
        watermark: Gaussian | None = None,
    ) -> None:
        p, n = input_matrix(setting).shape[1], len(setting.plant.initial_mean)
        if len(gain) != p or any(len(row) != n for row in gain):
            lengths = [len(row) for row in gain]
            raise ValueError(
                f"{setting.name}: the gain has rows of lengths {lengths}; give {p} rows of {n} entries"
            )
        if reference is not None and len(reference) != n:
            raise ValueError(f"{setting.name}: the reference has {len(reference)} entries, expected {n}")
        if watermark is not None and watermark.mean is not None and any(watermark.mean):
            raise ValueError(f"{setting.name}: a watermark has mean zero; leave the mean out")
        self.gain: Matrix = np.array(gain, dtype=np.float64)
        self._reference = np.zeros(n) if reference is None else np.array(reference, dtype=np.float64)
        self._factor = None if watermark is None else square_root(watermark.covariance_matrix(p))
        self._rng = setting.rng

    def control(self, step: int, state: Vector | None) -> Vector:
        """Return the input (p,) for step ``step + 1``, given the estimate (n,) of ``step`` or None."""
        asked: Vector = np.zeros(len(self.gain))
        if state is not None:
            asked = self.gain.dot(self._reference - state)
        if self._factor is not None:
            asked = asked + self._factor.dot(self._rng.standard_normal(len(self.gain)))
        return asked


def input_matrix(setting: ControllerSetting) -> Matrix:
    """Return ``B`` (n, p) of the plant; raises ValueError when it has no input."""
    B: Matrix | None = getattr(setting.plant, "B", None)
    if B is None or not B.size:
        raise ValueError(f"{setting.name}: the plant has no input; give it a matrix B")
    return B
