"""What the Kalman-type filters of nonlinear models share: the models, and the common course of a step."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence

import numpy as np

from bus.packets import Packet, Vector
from nodes.contract import Matrix, NonlinearPlant, NonlinearSensor, Setting
from nodes.estimators.arrivals import measurements
from nodes.estimators.commanded_input import Commanded, CommandedInput
from nodes.estimators.linear_gaussian import Measurement, refuse_innovations
from nodes.estimators.solitary import SolitaryGaussian
from nodes.lapack import dpotrf


def nonlinear_plant(setting: Setting) -> NonlinearPlant:
    """Return the setting's plant; raises ValueError when it has no transition, or no Jacobian of it."""
    if not isinstance(setting.plant, NonlinearPlant):
        raise ValueError(
            f"{setting.name}: plant {type(setting.plant).__name__} has no 'transition', 'jacobian' and 'Q'; "
            "use a plant that satisfies NonlinearPlant"
        )
    return setting.plant


def nonlinear_sensors(setting: Setting) -> dict[str, NonlinearSensor]:
    """Return the setting's sensors; raises ValueError for one without a model, or with singular noise."""
    models: dict[str, NonlinearSensor] = {}
    for name, sensor in setting.sensors.items():
        if not isinstance(sensor, NonlinearSensor):
            raise ValueError(
                f"{setting.name}: sensor {name} ({type(sensor).__name__}) has no 'measure', 'jacobian' and "
                "'R'; use a sensor that satisfies NonlinearSensor"
            )
        refuse_innovations(setting, name)
        if dpotrf(sensor.R)[1] != 0:
            raise ValueError(f"{setting.name}: sensor {name} has singular noise; give it a positive std")
        models[name] = sensor
    return models


class NonlinearKalman(Commanded, SolitaryGaussian, ABC):
    """A filter that keeps a mean and a covariance, and takes the packets of a step jointly.

    The prior of step 0 is the plant's initial law. A step without packets only predicts, and a packet sent
    in an earlier step is not used. A commanded input adds ``B u`` to the prediction, as for `Kalman`.
    """

    def __init__(self, setting: Setting) -> None:
        self._plant = nonlinear_plant(setting)
        self._sensors = nonlinear_sensors(setting)
        super().__init__(setting)
        self._input = CommandedInput(setting.plant)
        self._sizes = {name: len(sensor.R) for name, sensor in self._sensors.items()}

    @abstractmethod
    def _predict(self) -> None:
        """Move the mean and the covariance one step."""

    @abstractmethod
    def _update(self, packets: Sequence[Packet]) -> None:
        """Correct by at least one packet of this step, and set the NIS and its degrees of freedom."""

    def correct(self, step: int, packets: Sequence[Packet]) -> Vector | None:
        """Predict from the step before, then correct by this step's measurements; nothing is sent."""
        if step > 0:
            self._predict()
            self._state = self._input.add_to(self._state)
        self._nis, self._nis_dof = 0.0, 0
        current = measurements(step, packets, self._sizes)
        if current:
            self._update(current)
        return None


def propagate(plant: NonlinearPlant, state: Vector, covariance: Matrix) -> tuple[Vector, Matrix]:
    """Return ``f(x)`` (n,) and ``F P F' + Q`` (n, n), exactly symmetric, with the Jacobian F at x."""
    F = plant.jacobian(state)
    half = 0.5 * F.dot(covariance).dot(F.T)
    return plant.transition(state[None])[0], half + half.T + plant.Q


def linearise(
    sensors: Mapping[str, NonlinearSensor], state: Vector, packets: Sequence[Packet]
) -> tuple[Measurement, Vector]:
    """Return at least one packet as a linear measurement ``y - g(x) + C x`` with the Jacobian C at x."""
    measuring = [sensors[packet.source] for packet in packets]
    C = np.concatenate([sensor.jacobian(state) for sensor in measuring])
    predicted = np.concatenate([sensor.measure(state[None])[0] for sensor in measuring])
    values = np.concatenate([packet.values for packet in packets])
    model = Measurement(C, block_diagonal([sensor.R for sensor in measuring]))
    return model, values - predicted + C.dot(state)


def block_diagonal(blocks: Sequence[Matrix]) -> Matrix:
    """Return the matrix of blocks, which are square, along the diagonal."""
    if len(blocks) == 1:
        return blocks[0]
    size = sum(len(block) for block in blocks)
    whole = np.zeros((size, size))
    begin = 0
    for block in blocks:
        end = begin + len(block)
        whole[begin:end, begin:end] = block
        begin = end
    return whole
