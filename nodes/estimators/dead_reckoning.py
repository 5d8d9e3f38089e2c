"""Dead reckoning: a model that is followed without any measurement. What every filter should beat."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bus.packets import Packet, Vector
from nodes.contract import Setting
from nodes.estimators.commanded_input import Commanded, CommandedInput
from nodes.estimators.nonlinear_gaussian import nonlinear_plant, propagate
from nodes.estimators.solitary import SolitaryGaussian
from nodes.gaussian import Gaussian
from nodes.linear_algebra import square_root

_NO_ERROR = Gaussian(std=0.0)


class DeadReckoning(Commanded, SolitaryGaussian):
    """Predicts ``x+ = f(x)``, ``P+ = F P F' + Q`` from the initial law on, and hears nothing but commands.

    Parameters
    ----------
    setting
        The node's models: a plant with a transition and its Jacobian. Sensors and neighbours are not used.
    start_error
        Law of an error that the node adds to the plant's initial mean, drawn for itself; none by default.

    Raises
    ------
    ValueError
        When the plant is of another kind, or ``start_error`` does not fit its state.
    """

    def __init__(self, setting: Setting, *, start_error: Gaussian = _NO_ERROR) -> None:
        self._plant = nonlinear_plant(setting)
        super().__init__(setting)
        self._input = CommandedInput(setting.plant)
        self._state, added = start(setting, start_error)
        self._covariance = self._covariance + added

    def correct(self, step: int, packets: Sequence[Packet]) -> Vector | None:
        """Predict from the step before."""
        if step > 0:
            predicted, self._covariance = propagate(self._plant, self._state, self._covariance)
            self._state = self._input.add_to(predicted)
        return None


def start(setting: Setting, error: Gaussian) -> tuple[Vector, np.ndarray]:
    """Return the estimate (n,) that a node starts from, and the covariance (n, n) of what it has added."""
    mean = setting.plant.initial_mean
    covariance = error.covariance_matrix(len(mean))
    drawn = square_root(covariance).dot(setting.rng.standard_normal(len(mean)))
    own: Vector = mean + error.mean_vector(len(mean)) + drawn
    return own, covariance
