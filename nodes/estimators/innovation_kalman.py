"""The remote estimator of a smart sensor: it makes estimates of the innovations that it is sent."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from annotated_types import Gt

from bus.packets import Packet, Vector
from nodes.contract import Detection, Matrix, Setting
from nodes.estimators.linear_gaussian import Dynamics, mahalanobis_squared
from nodes.estimators.solitary import OnAlarm, SolitaryGaussian, rejects
from nodes.linear_algebra import symmetrise
from nodes.sensors.innovation import Innovation


class InnovationKalman(SolitaryGaussian):
    """Follows the filter of one smart sensor: ``x^ = A x^ + K z`` (Guo, Shi, Johansson, Shi 2017).

    Its error is that of the sensor's own filter, and, where an innovation is missing, what it missed:
    ``P + D`` with ``D = A D A' + K S K'`` in a step without innovation and ``D = A D A'`` in one with. The
    two parts are uncorrelated, since the sensor's error is orthogonal to all its past innovations. Of several
    packets of a step the first one of the right size counts; one sent in an earlier step is not used.

    With a ``threshold`` it carries a chi-square detector with the statistic ``z' S^-1 z``.

    Parameters
    ----------
    setting
        A linear plant, and exactly one sensor of the kind ``innovation``.
    threshold
        The detector raises an alarm on a packet whose statistic reaches it; None for no detector.
    on_alarm
        ``flag`` only notes the alarm; ``reject`` also treats the packet as a missing one.

    Raises
    ------
    ValueError
        When it does not listen to exactly one smart sensor, or there is nothing that could reject.
    """

    def __init__(
        self,
        setting: Setting,
        *,
        threshold: Annotated[float, Gt(0.0)] | None = None,
        on_alarm: OnAlarm = "flag",
    ) -> None:
        self._rejects = rejects(setting, on_alarm, threshold)
        first: object = next(iter(setting.sensors.values()), None)
        if len(setting.sensors) != 1 or not isinstance(first, Innovation):
            raise ValueError(
                f"{setting.name} listens to {', '.join(setting.sensors) or 'no sensor'}; "
                "this method needs exactly one sensor of the kind 'innovation'"
            )
        self._gains = first.filter_gains()
        self._dynamics = Dynamics(setting)
        super().__init__(setting)
        self._threshold = threshold
        self._missed: Matrix = np.zeros_like(self._dynamics.A)

    def correct(self, step: int, packets: Sequence[Packet]) -> Vector | None:
        """Predict from the step before, then add what this step's innovation asks for; nothing is sent."""
        A, gain = self._dynamics.A, self._gains.next()
        if step > 0:
            self._state = A.dot(self._state)
            self._missed = symmetrise(A.dot(self._missed).dot(A.T))
        self._nis, self._nis_dof, self._detections = 0.0, 0, ()
        arrived = False
        size = len(gain.S)
        for packet in [p for p in packets if p.sent_step == step and p.values.size == size][:1]:
            self._nis, self._nis_dof = mahalanobis_squared(packet.values, gain.factor), len(packet.values)
            alarm = False
            if self._threshold is not None:
                alarm = self._nis >= self._threshold
                self._detections = [Detection(packet.source, packet.sequence, self._nis, alarm)]
            arrived = not (alarm and self._rejects)
            if arrived:
                self._state = self._state + gain.K.dot(packet.values)
        if not arrived:
            self._missed = self._missed + gain.K.dot(gain.S).dot(gain.K.T)
        self._covariance = gain.P + self._missed
        return None
