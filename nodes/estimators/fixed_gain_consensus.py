"""A filter with a constant gain and a consensus term: the baseline of Ding 2021, section V."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Ge, Lt

from bus.packets import Packet, Vector
from nodes.contract import Belief, Listens, Matrix, Setting
from nodes.estimators.linear_gaussian import (
    Dynamics,
    SensorBank,
    cholesky,
    mahalanobis_squared,
)
from nodes.estimators.neighbourhood import Neighbourhood, state_mixing
from nodes.linear_algebra import symmetrise


class FixedGainConsensus:
    """A filter ``x^+ = x^- + K (y - C x^-)`` with a gain designed beforehand, drawn towards its neighbours.

    The prediction is ``x^- = A (x^+ + kappa sum_j h_j (x_j^+ - x^+))`` over the neighbours that arrived.
    The payload to the neighbours is ``x^+`` (n).

    The covariance that it publishes is exact for the filter alone: ``P^- = A P^+ A' + Q`` and ``P^+ = (I -
    K C) P^- (I - K C)' + K R K'`` over the packets that arrived. It leaves the coupling out, whose share
    would need the covariances between all nodes, and it knows of no attack.

    Parameters
    ----------
    setting
        A linear plant, linear sensors, and neighbours with their weights.
    gain
        ``K`` (n, m); a plain list is one column. With several sensors their columns stand side by side, in
        the order in which the sensors are listed; a lost packet leaves its columns out.
    coupling
        Strength ``kappa`` of the consensus term; 0 leaves the neighbours out.

    Raises
    ------
    ValueError
        When the plant or a sensor is not linear, a sensor's noise is singular, or the gain has another shape.
    """

    listens: ClassVar[Listens] = "paired"

    def __init__(
        self,
        setting: Setting,
        *,
        gain: list[float] | list[list[float]],
        coupling: Annotated[float, Ge(0.0), Lt(1.0)],
    ) -> None:
        self.rounds = 1 if coupling > 0.0 or setting.neighbours else 0
        self._dynamics = Dynamics(setting)
        self._sensors = SensorBank(setting)
        self._gains = _gain_of_each_sensor(gain, self._sensors, len(self._dynamics.A))
        self._updates = lru_cache(maxsize=256)(self._update_of)
        self._neighbourhood = Neighbourhood(
            setting, lambda weights: np.array([state_mixing(coupling, weights)])
        )
        self._received = 0
        self._mixture: Matrix | None = None
        self._state = setting.plant.initial_mean
        self._covariance = setting.plant.initial_covariance
        self._nis = 0.0
        self._nis_dof = 0

    def correct(self, step: int, packets: Sequence[Packet]) -> Vector | None:
        """Predict from the step before, correct by this step's measurements; return the payload (n,)."""
        if step > 0:
            mixed = self._state if self._mixture is None else self._mixture[0]
            self._state = self._dynamics.A.dot(mixed)
            self._covariance = self._dynamics.propagate(self._covariance)
        self._nis, self._nis_dof = 0.0, 0
        current = self._sensors.measurements(step, packets)
        if current:
            self._correct(current)
        return self._state

    def exchange(self, step: int, round_: int, packets: Sequence[Packet]) -> Vector | None:
        """Mix the neighbours' estimates with the node's own, for the next prediction."""
        self._received, self._mixture = self._neighbourhood.mix(step, self._state, packets)
        return None

    def estimate(self, step: int) -> Belief:
        """Return the corrected state, and the covariance that it would have without coupling."""
        return Belief(
            self._state,
            self._covariance,
            nis=self._nis,
            nis_dof=self._nis_dof,
            diagnostics={"neighbours_received": float(self._received)},
        )

    def _correct(self, packets: Sequence[Packet]) -> None:
        """Correct state and covariance by the packets of one step, taken jointly."""
        (C, R), values = self._sensors.stack(packets)
        gain, reduction, noise = self._updates(tuple([packet.source for packet in packets]))
        innovation = values - C.dot(self._state)
        self._nis = mahalanobis_squared(innovation, cholesky(C.dot(self._covariance).dot(C.T) + R))
        self._nis_dof = len(values)
        self._state = self._state + gain.dot(innovation)
        half = reduction.dot(self._covariance).dot(reduction.T)
        self._covariance = 0.5 * (half + half.T) + noise

    def _update_of(self, sources: tuple[str, ...]) -> tuple[Matrix, Matrix, Matrix]:
        """Return ``K`` (n, m), ``I - K C`` (n, n) and ``K R K'`` (n, n) of the sensors that arrived."""
        C, R = self._sensors.stacked(sources)
        gain = np.concatenate([self._gains[source] for source in sources], axis=1)
        return gain, np.eye(len(gain)) - gain.dot(C), symmetrise(gain.dot(R).dot(gain.T))


def _gain_of_each_sensor(
    gain: list[float] | list[list[float]], sensors: SensorBank, n: int
) -> dict[str, Matrix]:
    """Return the columns (n, m) of each sensor; raises ValueError when the gain does not fit."""
    rows = [row if isinstance(row, list) else [row] for row in gain]
    outputs = sum(len(model.C) for model in sensors.models.values())
    if len(rows) != n or any(len(row) != outputs for row in rows):
        raise ValueError(
            f"gain has {len(rows)} rows of lengths {sorted({len(row) for row in rows})}; "
            f"give {n} rows (state components) of {outputs} (measured outputs)"
        )
    matrix = np.array(rows, dtype=np.float64)
    columns: dict[str, Matrix] = {}
    begin = 0
    for name, model in sensors.models.items():
        columns[name] = np.ascontiguousarray(matrix[:, begin : begin + len(model.C)])
        begin += len(model.C)
    return columns
