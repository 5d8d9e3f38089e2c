"""What the estimators share that work alone: none tells its neighbours anything, nor hears them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Literal

from bus.packets import Packet, Vector
from nodes.contract import Belief, Detection, Listens, Matrix, Setting

OnAlarm = Literal["flag", "reject"]
"""What follows an alarm on a packet: nothing, or the packet is left out."""


class Solitary:
    """An estimator without neighbours."""

    listens: ClassVar[Listens] = "paired"
    rounds: int = 0

    def exchange(self, step: int, round_: int, packets: Sequence[Packet]) -> Vector | None:
        """Do nothing: it works alone."""
        return None


class SolitaryGaussian(Solitary):
    """An estimator without neighbours that keeps one Gaussian: a mean (n,) and a covariance (n, n).

    It starts from the plant's initial law. The NIS, its degrees of freedom and the verdicts of a step are for
    `correct` to set.
    """

    def __init__(self, setting: Setting) -> None:
        self._state: Vector = setting.plant.initial_mean
        self._covariance: Matrix = setting.plant.initial_covariance
        self._nis = 0.0
        self._nis_dof = 0
        self._detections: Sequence[Detection] = ()

    def estimate(self, step: int) -> Belief:
        """Return mean and covariance, the NIS, and a detector's verdicts if it has one."""
        return Belief(
            self._state,
            self._covariance,
            nis=self._nis,
            nis_dof=self._nis_dof,
            detections=self._detections,
        )


def rejects(setting: Setting, on_alarm: OnAlarm, threshold: float | None) -> bool:
    """Return whether alarms reject; raises ValueError when no threshold makes any."""
    if on_alarm == "reject" and threshold is None:
        raise ValueError(f"{setting.name}: without a detector nothing is rejected; give it a 'threshold'")
    return on_alarm == "reject"
