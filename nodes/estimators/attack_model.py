"""How an attack's signal enters a plant and its sensors, as estimators are told it.

A map is ``value = f(x, a)``: the dynamics, or a sensor. Linear ones are matrices; others are linearised
around each component, by a tangent or by sigma points.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, Protocol, runtime_checkable

import numpy as np

from nodes.contract import LinearPlant, LinearSensor, Matrix, Setting
from nodes.estimators.gaussian_mixture import Stack, symmetric
from nodes.estimators.joint_input_state import Linearised
from nodes.lapack import dpotrf

Function = Callable[[Matrix, Matrix], Matrix]
"""States (J, n) and signals (J, q) to values (J, m)."""
MomentRule = Literal["linear", "ekf", "ukf"]
_STEP = float(np.finfo(np.float64).eps) ** (1.0 / 3.0)


@runtime_checkable
class SmoothPlant(Protocol):
    """A plant ``x+ = f(x, a) + w``, ``w ~ N(0, Q)``, that need not be linear; ``a`` has ``signal_size`` q."""

    Q: Matrix
    signal_size: int

    def transition(self, states: Matrix, signals: Matrix) -> Matrix:
        """Return ``f`` (J, n) of states (J, n) and signals (J, q)."""
        ...


@runtime_checkable
class SmoothSensor(Protocol):
    """A sensor ``y = h(x, a) + v``, ``v ~ N(0, R)``, that need not be linear."""

    R: Matrix

    def measure(self, states: Matrix, signals: Matrix) -> Matrix:
        """Return ``h`` (J, m) of states (J, n) and signals (J, q)."""
        ...


class Map(Protocol):
    """What becomes of Gaussian laws."""

    noise: Matrix

    def plain(self, means: Matrix, covariances: Stack) -> Linearised:
        """Map laws of the state alone, without attack."""
        ...

    def joint(self, means: Matrix, covariances: Stack) -> Linearised:
        """Map laws of state and signal."""
        ...


class LinearMap:
    """``value = A x + G a``: exact."""

    def __init__(self, A: Matrix, G: Matrix, noise: Matrix) -> None:
        self.noise = noise
        self._plain = np.ascontiguousarray(A)[None]
        self._joint = np.concatenate((A, G), axis=1)[None]

    def plain(self, means: Matrix, covariances: Stack) -> Linearised:
        """Map laws of the state alone, without attack."""
        return Linearised(means.dot(self._plain[0].T), self._plain)

    def joint(self, means: Matrix, covariances: Stack) -> Linearised:
        """Map laws of state and signal."""
        return Linearised(means.dot(self._joint[0].T), self._joint)


class SmoothMap:
    """``value = f(x, a)``, linearised: by a tangent at the mean, or statistically by sigma points.

    Parameters
    ----------
    function
        The map.
    noise
        Covariance (m, m) of what is added to the value.
    signal_size
        The size q of the signal.
    rule
        ``ekf``: the tangent, by central differences. ``ukf``: 2 d + 1 sigma points of Julier and Uhlmann with
        ``kappa = max(0, 3 - d)``, which leaves no weight negative; the slope is the regression on them.
    """

    def __init__(
        self, function: Function, noise: Matrix, signal_size: int, rule: Literal["ekf", "ukf"]
    ) -> None:
        self.noise = noise
        self._function = function
        self._q = signal_size
        self._linearise = _tangent if rule == "ekf" else _regression

    def plain(self, means: Matrix, covariances: Stack) -> Linearised:
        """Map laws of the state alone, without attack."""
        return self._linearise(self._without_attack, means, covariances)

    def joint(self, means: Matrix, covariances: Stack) -> Linearised:
        """Map laws of state and signal."""
        return self._linearise(self._under_attack, means, covariances)

    def _without_attack(self, points: Matrix) -> Matrix:
        return self._function(points, np.zeros((len(points), self._q)))

    def _under_attack(self, points: Matrix) -> Matrix:
        n = points.shape[1] - self._q
        return self._function(points[:, :n], points[:, n:])


def _at_all(function: Callable[[Matrix], Matrix], points: Stack) -> Stack:
    """Return the values (J, s, m) at points (J, s, d)."""
    values = function(points.reshape(-1, points.shape[2]))
    return values.reshape(points.shape[0], points.shape[1], values.shape[1])


def _tangent(function: Callable[[Matrix], Matrix], means: Matrix, covariances: Stack) -> Linearised:
    """Return value and tangent at the means (J, d), all points in one call."""
    d = means.shape[1]
    step = _STEP * np.maximum(1.0, np.abs(means))
    offsets = np.eye(d) * step[:, None, :]
    points = np.concatenate((means[:, None, :], means[:, None, :] + offsets, means[:, None, :] - offsets), 1)
    values = _at_all(function, points)
    taken = (points[:, 1 : d + 1] - points[:, d + 1 :]).diagonal(axis1=1, axis2=2)
    slope = (values[:, 1 : d + 1] - values[:, d + 1 :]) / taken[:, :, None]
    return Linearised(values[:, 0], np.ascontiguousarray(slope.swapaxes(1, 2)))


def _regression(function: Callable[[Matrix], Matrix], means: Matrix, covariances: Stack) -> Linearised:
    """Return value, slope and residual covariance by sigma points of the laws, all points in one call."""
    d = means.shape[1]
    kappa = max(0.0, 3.0 - d)
    roots = np.linalg.cholesky(covariances)
    offsets = np.sqrt(d + kappa) * roots.swapaxes(1, 2)
    centre = means[:, None, :]
    points = np.concatenate((centre, centre + offsets, centre - offsets), axis=1)
    weights = np.full(2 * d + 1, 0.5 / (d + kappa))
    weights[0] = kappa / (d + kappa)
    values = _at_all(function, points)
    value = np.einsum("s,jsm->jm", weights, values)
    deviations = values - value[:, None, :]
    covariance = np.einsum("s,jsm,jsk->jmk", weights, deviations, deviations)
    # The deviations on the factor's own axes: P_zy = roots * whitened, so that P^-1 needs no further solve.
    whitened = (0.5 / np.sqrt(d + kappa)) * (values[:, 1 : d + 1] - values[:, d + 1 :])
    slope = np.linalg.solve(roots.swapaxes(1, 2), whitened).swapaxes(1, 2)
    explained = np.matmul(whitened.swapaxes(1, 2), whitened)
    return Linearised(value, np.ascontiguousarray(slope), symmetric(covariance - explained))


class AttackModel:
    """The models of a setting with the ways of an attack's signal: the dynamics and, by name, the sensors.

    Parameters
    ----------
    setting
        The node's models.
    signal_size
        The size q of the signal.
    rule
        How moments are found; ``linear`` needs linear models.
    feedthrough
        Whether the signal is to be found in the measurement of its own step, or of the next.

    Raises
    ------
    ValueError
        When a model does not fit the rule or the signal, a sensor's noise is singular, or a direction of the
        signal is in none of the measurements.
    """

    def __init__(self, setting: Setting, signal_size: int, rule: MomentRule, feedthrough: bool) -> None:
        self.n = len(setting.plant.initial_mean)
        self.q = signal_size
        self._name = setting.name
        self.dynamics = self._dynamics(setting.plant, rule)
        self.sensors = {name: self._sensor(name, sensor, rule) for name, sensor in setting.sensors.items()}
        at = np.concatenate((setting.plant.initial_mean, np.zeros(signal_size)))[None]
        law = np.zeros((1, at.size, at.size))
        law[0, : self.n, : self.n] = setting.plant.initial_covariance
        law[0] += 1e-12 * np.eye(at.size)
        self._refuse_what_cannot_be_seen(at, law, feedthrough)

    def _dynamics(self, plant: Any, rule: MomentRule) -> Map:
        if rule != "linear" and isinstance(plant, SmoothPlant):
            if plant.signal_size != self.q:
                raise ValueError(
                    f"{self._name}: the attack prior has {self.q} components, the plant's signal "
                    f"{plant.signal_size}; give as many"
                )
            return SmoothMap(plant.transition, plant.Q, self.q, rule)
        if not isinstance(plant, LinearPlant):
            raise ValueError(
                f"{self._name}: plant {type(plant).__name__} is not linear; use a linear plant, or moments "
                "'ekf' or 'ukf' with a plant that has 'transition', 'Q' and 'signal_size'"
            )
        return self._map(rule, plant.A, self._entry("G", plant, self.n), plant.Q)

    def _sensor(self, name: str, sensor: Any, rule: MomentRule) -> Map:
        if not isinstance(sensor, LinearSensor | SmoothSensor):
            raise ValueError(
                f"{self._name}: sensor {name} ({type(sensor).__name__}) has no model that this method knows; "
                "use a linear sensor, or one with 'measure' and 'R'"
            )
        if dpotrf(sensor.R)[1] != 0:
            raise ValueError(f"{self._name}: sensor {name} has singular noise; give it a positive std")
        if isinstance(sensor, LinearSensor):
            return self._map(rule, sensor.C, self._entry("H", sensor, len(sensor.C)), sensor.R)
        if rule == "linear":
            raise ValueError(
                f"{self._name}: sensor {name} ({type(sensor).__name__}) is not linear; use moments 'ekf' or "
                "'ukf'"
            )
        return SmoothMap(sensor.measure, sensor.R, self.q, rule)

    def _map(self, rule: MomentRule, A: Matrix, G: Matrix, noise: Matrix) -> Map:
        """Return a linear map; under a rule for others it runs through the same code as they do."""
        if rule == "linear":
            return LinearMap(A, G, noise)
        return SmoothMap(lambda states, signals: states.dot(A.T) + signals.dot(G.T), noise, self.q, rule)

    def _entry(self, name: str, model: object, rows: int) -> Matrix:
        """Return ``G`` or ``H`` (rows, q), zero when the model has none."""
        matrix = getattr(model, name, None)
        if matrix is None or matrix.shape[1] == 0:
            return np.zeros((rows, self.q))
        if matrix.shape != (rows, self.q):
            raise ValueError(
                f"{self._name}: {name} of {type(model).__name__} has the shape {matrix.shape}, but the "
                f"attack prior has {self.q} components; give as many"
            )
        return np.ascontiguousarray(matrix, dtype=np.float64)

    def _refuse_what_cannot_be_seen(self, at: Matrix, law: Stack, feedthrough: bool) -> None:
        """Raise ValueError when the stacked ``H``, or ``C G``, has not full column rank."""
        entry = self.dynamics.joint(at, law).slope[0][:, self.n :]
        slopes = [sensor.joint(at, law).slope[0] for sensor in self.sensors.values()]
        rows = [slope[:, self.n :] if feedthrough else slope[:, : self.n].dot(entry) for slope in slopes]
        stacked = np.concatenate(rows) if rows else np.zeros((0, self.q))
        matrix = "H" if feedthrough else "C G"
        if not stacked.any():
            cure = "set 'feedthrough: false'" if feedthrough else "let G reach what is measured"
            raise ValueError(
                f"{self._name}: {matrix} is zero: no measurement that it listens to shows the attack; {cure}"
            )
        _, values, directions = np.linalg.svd(np.concatenate((stacked, np.zeros((self.q, self.q)))))
        hidden = directions[values <= 1e-9 * values[0]]
        if len(hidden):
            listed = "; ".join(str(np.round(direction, 4).tolist()) for direction in hidden)
            raise ValueError(
                f"{self._name}: ({matrix})' S^-1 {matrix} is singular: no measurement that it listens to "
                f"shows the attack in the direction {listed}; add a sensor that does, or leave that "
                "direction out of the signal"
            )
