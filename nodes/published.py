"""What an estimator publishes of one step, as its arrays: what an `Estimate` tells."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import msgspec

from bus.messages import Estimate
from bus.packets import Vector
from nodes.contract import Belief, Detection, Matrix


class Published(msgspec.Struct, frozen=True):
    """A belief on its way: ``state`` (n,), ``covariance`` (n, n); without entries for a diverged estimator.

    All of it is its own, whatever the estimator does next.
    """

    step: int
    t: float
    refers_to: int
    state: Vector
    covariance: Matrix
    nis: float
    nis_dof: int
    detections: Sequence[Detection]
    diagnostics: Mapping[str, float]
    refused: int

    @property
    def diverged(self) -> bool:
        """Whether the estimator has diverged."""
        return not self.state.size

    @property
    def diagnostic_name(self) -> list[str]:
        """The names of its diagnostics."""
        return list(self.diagnostics)

    @property
    def diagnostic_value(self) -> list[float]:
        """Their values; numbers of numpy's own types become Python's, which JSON knows."""
        return [float(value) for value in self.diagnostics.values()]

    def message(self) -> Estimate:
        """Return the message that tells it."""
        covariance: list[float] = self.covariance.ravel().tolist()
        variances = covariance[:: self.state.size + 1]
        detections = self.detections
        return Estimate(
            step=self.step,
            t=self.t,
            refers_to=self.refers_to,
            diverged=self.diverged,
            state=self.state.tolist(),
            covariance=covariance,
            covariance_shape=list(self.covariance.shape),
            sigma=[math.sqrt(variance) if variance > 0.0 else 0.0 for variance in variances],
            nis=self.nis,
            nis_dof=self.nis_dof,
            detector_source=[detection.source for detection in detections],
            detector_sequence=[detection.sequence for detection in detections],
            detector_statistic=[float(detection.statistic) for detection in detections],
            detector_alarm=[bool(detection.alarm) for detection in detections],
            diagnostic_name=self.diagnostic_name,
            diagnostic_value=self.diagnostic_value,
            refused=self.refused,
        )


def published(step: int, t: float, belief: Belief, refused: int) -> Published:
    """Return a belief, as `nodes.checked` lets it pass, on its way."""
    return Published(
        step,
        t,
        step if belief.refers_to is None else belief.refers_to,
        belief.state.copy(),
        belief.covariance.copy(),
        float(belief.nis),
        belief.nis_dof,
        tuple(belief.detections),
        dict(belief.diagnostics),
        refused,
    )
