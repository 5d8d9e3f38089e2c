"""The Kalman filter of one node: optimal for the measurements that arrive, if none is attacked."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

from annotated_types import Gt

from bus.packets import Packet, Vector
from nodes.contract import Detection, Setting
from nodes.estimators.commanded_input import Commanded, CommandedInput
from nodes.estimators.linear_gaussian import (
    Correction,
    Dynamics,
    SensorBank,
    cholesky,
    correct,
    mahalanobis_squared,
)
from nodes.estimators.solitary import OnAlarm, SolitaryGaussian, rejects


class Kalman(Commanded, SolitaryGaussian):
    """A Kalman filter on the packets of the sensors that it listens to, without neighbours (Kalman 1960).

    The prior of step 0 is the plant's initial law; the measurements of step 0 already correct it. The
    packets of a step are taken jointly, and a step without packets only predicts. A packet sent in an
    earlier step is not used. Where a controller tells it the input ``u`` (p,), it predicts with
    ``x^- = A x^+ + B u``; an input that it was not told counts as the plant counts a lost one.

    With a ``threshold`` it carries a chi-square detector: the statistic of a packet is ``eta' S^-1 eta``,
    with the packet's innovation ``eta`` (m,) and the block ``S`` (m, m) of ``C P^- C' + R`` that belongs to
    it. Without an attack it is chi-squared with m degrees of freedom.

    Parameters
    ----------
    setting
        The node's models: a linear plant, and linear sensors whose noise is not singular.
    threshold
        The detector raises an alarm on a packet whose statistic reaches it; None for no detector.
    on_alarm
        ``flag`` only notes the alarm; ``reject`` also leaves the packet out.

    Raises
    ------
    ValueError
        When the plant or a sensor is not linear, a sensor's noise is singular, or there is nothing that
        could reject.
    """

    def __init__(
        self,
        setting: Setting,
        *,
        threshold: Annotated[float, Gt(0.0)] | None = None,
        on_alarm: OnAlarm = "flag",
    ) -> None:
        self._rejects = rejects(setting, on_alarm, threshold)
        self._threshold = threshold
        self._dynamics = Dynamics(setting)
        self._sensors = SensorBank(setting)
        self._input = CommandedInput(setting.plant)
        super().__init__(setting)

    def correct(self, step: int, packets: Sequence[Packet]) -> Vector | None:
        """Predict from the step before, then correct by this step's measurements; nothing is sent."""
        if step > 0:
            self._state = self._input.add_to(self._dynamics.A.dot(self._state))
            self._covariance = self._dynamics.propagate(self._covariance)
        self._nis, self._nis_dof, self._detections = 0.0, 0, ()
        current = self._sensors.measurements(step, packets)
        if current:
            model, values = self._sensors.stack(current)
            correction = correct(self._state, self._covariance, model, values)
            self._nis, self._nis_dof = correction.nis, len(values)
            if self._threshold is None:
                self._state, self._covariance = correction.state, correction.covariance
            else:
                self._judge(current, correction, self._threshold)
        return None

    def _judge(self, packets: Sequence[Packet], correction: Correction, threshold: float) -> None:
        """Give the verdicts on the packets of a joint correction, and correct by what is left."""
        statistics = _statistics(packets, correction)
        self._detections = [
            Detection(packet.source, packet.sequence, statistic, statistic >= threshold)
            for packet, statistic in zip(packets, statistics, strict=True)
        ]
        if self._rejects and any(detection.alarm for detection in self._detections):
            verdicts = zip(packets, self._detections, strict=True)
            left = [packet for packet, verdict in verdicts if not verdict.alarm]
            if not left:
                return
            correction = correct(self._state, self._covariance, *self._sensors.stack(left))
        self._state, self._covariance = correction.state, correction.covariance


def _statistics(packets: Sequence[Packet], correction: Correction) -> list[float]:
    """Return the statistic of each packet of a joint correction under the packet's own block of ``S``."""
    if len(packets) == 1:
        return [correction.nis]
    statistics, begin = [], 0
    for packet in packets:
        end = begin + len(packet.values)
        rows = correction.factor[begin:end]
        factor = cholesky(rows.dot(rows.T))
        statistics.append(mahalanobis_squared(correction.innovation[begin:end], factor))
        begin = end
    return statistics
