"""What the distributed filters share: prediction, measurements as information, means over neighbours."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, NamedTuple, Protocol

import numpy as np

from bus.packets import Packet, Vector
from nodes.contract import Belief, LinearPlant, LinearSensor, Listens, Matrix, Setting
from nodes.estimators.arrivals import measurements
from nodes.estimators.commanded_input import CommandedInput
from nodes.estimators.linear_gaussian import (
    Dynamics,
    Measurement,
    SensorBank,
    cholesky,
    mahalanobis_squared,
)
from nodes.estimators.nonlinear_gaussian import linearise, nonlinear_plant, nonlinear_sensors, propagate
from nodes.lapack import dpotrf, dtrtrs


class Linearised(NamedTuple):
    """The measurements of one node in one step as ``values = C x + v``, ``v ~ N(0, R)``."""

    model: Measurement
    values: Vector

    def information(self) -> tuple[Vector, Matrix]:
        """Return ``C' R^-1 y`` (n,) and ``C' R^-1 C`` (n, n)."""
        factor = cholesky(self.model.R)
        C = dtrtrs(factor, self.model.C, lower=1)[0]
        values = dtrtrs(factor, self.values, lower=1)[0]
        return C.T.dot(values), C.T.dot(C)


class LocalModel(Protocol):
    """The models of one node."""

    def predict(self, state: Vector, covariance: Matrix) -> tuple[Vector, Matrix]:
        """Return the state (n,) and covariance (n, n) one step on, without any input."""
        ...

    def measured(self, step: int, state: Vector, packets: Sequence[Packet]) -> Linearised | None:
        """Return the measurements of ``step`` that arrived, around a state (n,); None when none did."""
        ...


class LinearModel:
    """A linear plant and linear sensors; see `Dynamics` and `SensorBank` for what they refuse."""

    def __init__(self, setting: Setting) -> None:
        self._dynamics = Dynamics(setting)
        self._sensors = SensorBank(setting)

    def predict(self, state: Vector, covariance: Matrix) -> tuple[Vector, Matrix]:
        """Return ``A x`` and ``A P A' + Q``."""
        return self._dynamics.A.dot(state), self._dynamics.propagate(covariance)

    def measured(self, step: int, state: Vector, packets: Sequence[Packet]) -> Linearised | None:
        """Return the measurements as they are: a linear model needs no state."""
        current = self._sensors.measurements(step, packets)
        return Linearised(*self._sensors.stack(current)) if current else None


class LinearisedModel:
    """A plant and sensors with Jacobians, as an extended Kalman filter takes them."""

    def __init__(self, setting: Setting) -> None:
        self._plant = nonlinear_plant(setting)
        self._sensors = nonlinear_sensors(setting)
        self._sizes = {name: len(sensor.R) for name, sensor in self._sensors.items()}

    def predict(self, state: Vector, covariance: Matrix) -> tuple[Vector, Matrix]:
        """Return ``f(x)`` and ``F P F' + Q`` with the Jacobian F at x."""
        return propagate(self._plant, state, covariance)

    def measured(self, step: int, state: Vector, packets: Sequence[Packet]) -> Linearised | None:
        """Return ``y - g(x) + C x`` with the Jacobian C at x."""
        current = measurements(step, packets, self._sizes)
        return Linearised(*linearise(self._sensors, state, current)) if current else None


class LocalFilter:
    """State and covariance of one node, from the plant's initial law on, and what they are predicted with.

    ``nis`` and ``nis_dof`` are those of the step's own measurements under the prediction, and ``received``
    counts the neighbours' payloads of the step; all three are for `belief` to tell.

    Raises
    ------
    ValueError
        When the models have neither matrices nor Jacobians, a sensor's noise is singular, or the initial
        law is.
    """

    def __init__(self, setting: Setting) -> None:
        linear = isinstance(setting.plant, LinearPlant) and all(
            isinstance(sensor, LinearSensor) for sensor in setting.sensors.values()
        )
        self._model: LocalModel = LinearModel(setting) if linear else LinearisedModel(setting)
        self._input = CommandedInput(setting.plant)
        self.nis, self.nis_dof, self.received = 0.0, 0, 0
        self.state: Vector = setting.plant.initial_mean
        self.covariance: Matrix = np.ascontiguousarray(setting.plant.initial_covariance)
        if dpotrf(self.covariance)[1] != 0:
            raise ValueError(
                f"{setting.name}: the plant's initial law is singular, and has no information matrix; "
                "give every component of 'initial' a positive std"
            )

    def control(self, packets: Sequence[Packet]) -> None:
        """Take the input that was commanded, for the prediction that follows."""
        self._input.take(packets)

    def predict(self, step: int) -> None:
        """Move the state and the covariance to ``step``; step 0 is where they begin."""
        if step > 0:
            predicted, self.covariance = self._model.predict(self.state, self.covariance)
            self.state = self._input.add_to(predicted)

    def measured(self, step: int, packets: Sequence[Packet]) -> Linearised | None:
        """Return the measurements of ``step`` that arrived, around the state; None when none did."""
        return self._model.measured(step, self.state, packets)

    def begin(self, step: int, packets: Sequence[Packet]) -> tuple[Vector, Matrix]:
        """Predict; return the information (n,), (n, n) of the step's own measurements, and note their NIS."""
        self.predict(step)
        self.nis, self.nis_dof, self.received = 0.0, 0, 0
        measured = self.measured(step, packets)
        if measured is None:
            return no_information(len(self.state))
        (C, R), values = measured
        factor = cholesky(C.dot(self.covariance).dot(C.T) + R)
        self.nis, self.nis_dof = mahalanobis_squared(values - C.dot(self.state), factor), len(values)
        return measured.information()

    def belief(self) -> Belief:
        """Return state and covariance, the NIS, and as a diagnostic ``neighbours_received``."""
        return Belief(
            self.state,
            self.covariance,
            nis=self.nis,
            nis_dof=self.nis_dof,
            diagnostics={"neighbours_received": float(self.received)},
        )

    def add_information(self, vector: Vector, matrix: Matrix) -> None:
        """Correct by measurements given as ``C' R^-1 y`` (n,) and ``C' R^-1 C`` (n, n).

        ``M = (P^-1 + S)^-1`` is ``L (I + L' S L)^-1 L'`` with ``P = L L'``: nothing is inverted.
        """
        root = cholesky(self.covariance)
        inner = cholesky(np.eye(len(root)) + root.T.dot(matrix).dot(root))
        whitened = dtrtrs(inner, root.T, lower=1)[0]
        self.covariance = whitened.T.dot(whitened)
        self.state = self.state + self.covariance.dot(vector - matrix.dot(self.state))


class NetworkedFilter:
    """A method of several nodes, each around its `LocalFilter`, whose belief it publishes."""

    listens: ClassVar[Listens] = "paired"

    def __init__(self, setting: Setting, *, rounds: int) -> None:
        self.rounds = rounds if setting.neighbours else 0
        self._filter = LocalFilter(setting)

    def control(self, step: int, packets: Sequence[Packet]) -> None:
        """Take the input that was commanded in ``step``, for the prediction that follows."""
        self._filter.control(packets)

    def estimate(self, step: int) -> Belief:
        """Return the state, and the covariance that the method has for it.

        Diagnostics: ``neighbours_received`` counts the payloads of neighbours that arrived, in all rounds
        unless `exchange` says otherwise.
        """
        return self._filter.belief()


def no_information(size: int) -> tuple[Vector, Matrix]:
    """Return what no measurement tells about a state of ``size`` components."""
    return np.zeros(size), np.zeros((size, size))


def inverse(matrix: Matrix) -> Matrix:
    """Return the inverse (n, n) of a positive definite matrix by its Cholesky factor; NaN for another."""
    root = dtrtrs(cholesky(matrix), np.eye(len(matrix)), lower=1)[0]
    product: Matrix = root.T.dot(root)
    return product


def arrived(step: int, size: int, packets: Sequence[Packet]) -> dict[str, Vector]:
    """Return the neighbours' payloads of this step and of ``size`` values by sender; the last of several."""
    return {p.source: p.values for p in packets if p.sent_step == step and p.values.size == size}


class ConsensusWeights:
    """What a node gives its neighbours and itself in a weighted mean.

    The graph's weights h_ij, and what they leave to one for the node itself (``weights: metropolis``, or
    as stated). Weights that sum to one leave it nothing (``in_degree``): then each of its d neighbours
    gets ``h_ij d / (d + 1)``, and the node ``1 / (d + 1)``. The weight of a neighbour that did not arrive
    falls to the node itself.

    Raises
    ------
    ValueError
        When a weight is not positive, or they sum to more than one.
    """

    def __init__(self, setting: Setting) -> None:
        stated = dict(setting.neighbours)
        total = sum(stated.values())
        if any(weight <= 0.0 for weight in stated.values()) or total > 1.0 + 1e-9:
            raise ValueError(
                f"{setting.name}: the weights {stated} must be positive and sum to at most 1; "
                "set 'weights: metropolis' in the graph"
            )
        share = len(stated) / (len(stated) + 1.0) if total > 1.0 - 1e-9 else 1.0
        self._of = {name: weight * share for name, weight in stated.items()}

    def mean(self, own: Vector, others: dict[str, Vector]) -> Vector:
        """Return the weighted mean (m,) of the node's own payload and the neighbours' that arrived."""
        mean = own.copy()
        for name, weight in self._of.items():
            if name in others:
                mean += weight * (others[name] - own)
        return mean
