"""Send by a draw that is the more likely the more a value differs from its prediction."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, MinLen

from bus.packets import Vector
from nodes.contract import Matrix
from nodes.linear_algebra import symmetrise
from nodes.triggers.comparing import compared, sized, weight_matrix
from nodes.triggers.contract import GaussianSilence, TriggerSetting
from nodes.triggers.prediction import Prediction, prediction_of


class StochasticInnovation:
    """Stays quiet with probability ``exp(-z' Y z / 2)`` (Han, Mo, Wu, Weerakkody, Sinopoli, Shi 2015).

    In the ``closed`` loop z is the innovation ``y - C x^-`` of a filter that only knows what this sensor has
    sent and when it was silent; the sender runs it, and so may a receiver. In the ``open`` loop z is what is
    to be sent itself, which needs no model: for a plant around zero, for a smart sensor's innovations, and
    for estimators. Either way the state stays Gaussian given silence, and `EventTriggeredKalman` is optimal.

    One number is drawn in every slot.

    Parameters
    ----------
    setting
        The sender's; in the closed loop a linear sensor on a linear plant without input.
    Y
        Weight (m, m), positive definite, in the inverse square of the unit of what is sent; one number stands
        for a multiple of the unit matrix. The larger it is, the more is sent.
    loop
        What z is, see above.
    components
        The components of what is sent that count, in the open loop; without it all.

    Raises
    ------
    ValueError
        When the closed loop has no prediction, ``Y`` does not fit, or it is not positive definite.
    """

    def __init__(
        self,
        setting: TriggerSetting,
        *,
        Y: float | list[list[float]],
        loop: Literal["closed", "open"] = "closed",
        components: Annotated[list[Annotated[int, Ge(0)]], MinLen(1)] | None = None,
    ) -> None:
        if components is not None and loop == "closed":
            raise ValueError(
                f"{setting.name}: 'components' is for the open loop; give 'loop: open', or Y alone"
            )
        self._weight = weight_matrix(Y, "Y")
        self._prediction: Prediction | None = prediction_of(setting) if loop == "closed" else None
        self._components = components
        self._rng = setting.rng
        R = getattr(setting.sensor, "R", None)
        self._told: Matrix | None = None
        if R is not None and components is None:
            whole = sized(self._weight, len(R), "Y")
            self._told = symmetrise(np.asarray(np.linalg.solve(whole, np.eye(len(R))), dtype=np.float64))

    def sends(self, step: int, values: Vector, reference: Vector | None = None) -> bool:
        """Return what the draw of this slot decides of the values (m,)."""
        centre = self._centre(step, values.size)
        z = compared(values - centre, self._components)
        Y = sized(self._weight, z.size, "Y")
        quiet = self._rng.random() <= np.exp(-0.5 * float(z.dot(Y).dot(z)))
        self.note(step, None if quiet else values)
        return not quiet

    def silence(self, step: int) -> GaussianSilence | None:
        """Return what silence tells of a sensor's value; None where not all components count."""
        if self._told is None:
            return None
        return GaussianSilence(self._centre(step, len(self._told)), self._told)

    def note(self, step: int, values: Vector | None) -> None:
        """Take what was sent (m,), None for a quiet slot."""
        if self._prediction is not None and self._told is not None:
            centre, _ = self._prediction.at(step)
            self._prediction.note(step, values, GaussianSilence(centre, self._told))

    def _centre(self, step: int, size: int) -> Vector:
        return np.zeros(size) if self._prediction is None else self._prediction.at(step)[0]
