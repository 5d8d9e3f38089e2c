"""The distributed secure filter of Ding, Wang, Han, Zhang 2021 (recursive, over Gilbert-Elliott channels)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, ClassVar, Literal

import numpy as np
from annotated_types import Ge, Gt, Lt

from bus.packets import Packet, Vector
from nodes.contract import Belief, Detection, Listens, Matrix, Setting
from nodes.estimators.covariance_bounds import LowerBound
from nodes.estimators.linear_gaussian import (
    Correction,
    Dynamics,
    SensorBank,
    cholesky,
    correct,
    mahalanobis_squared,
)
from nodes.estimators.neighbourhood import Neighbourhood, state_mixing


class SecureDistributed:
    """A Kalman-type filter with a consensus term and a detector that discards implausible measurements.

    The method is that of Ding 2021. Covariances between neighbours are unknown, so the filter carries an
    upper bound ``Pi`` on its error covariance (26), (35), which gives the gain (32), and a lower bound
    ``Gamma`` (17)-(19), which gives the detector (25). A packet to the neighbours is the estimate (n)
    followed by ``Pi`` (n * n, row-major). Several sensors are taken one after the other, each packet with
    its own verdict.

    **The bounds with a flag for each link.** Let s be the sum of the weights h_j of the neighbours that
    arrived, and s <= 1. Then ``xi xi' <= s sum_j h_j (e_i - e_j)(e_i - e_j)'`` by convexity, and each term
    is below ``2 e_i e_i' + 2 e_j e_j'``; hence ``E xi xi' <= 2 (Pi_i + sum_j Pi_j)`` over those j alone,
    whichever they are.

    **Lock-out.** While an attack is rejected the true error grows; ``Gamma`` does not, so that good
    measurements may be rejected ever after. ``readmission`` is a remedy that the paper does not have. A
    sensor that failed the detector ``readmit_after`` times in a row is given a second hearing, until it
    passes the detector again:

    - ``own_bound``: under ``C Pi^- C' + R``. It ends every lock-out, at the price that ``Pi`` grows under
      rejection until a lasting attack is let in.
    - ``neighbours``: against the weighted mean of the neighbours' estimates under the same mean of their
      ``Pi``, which is a bound on its error. An attack must deceive the neighbours too; with no neighbour's
      packet nothing is readmitted.

    Parameters
    ----------
    setting
        A linear plant, linear sensors, and neighbours whose weights h_ij sum to at most 1.
    coupling
        Strength ``kappa`` of the consensus term; 0 leaves the neighbours out.
    threshold
        A packet is rejected when the detector's statistic reaches it: a quantile of chi-squared with m
        degrees of freedom (25 is five sigma for one output).
    detector
        ``lower_bound`` is the paper's: ``eta' (C Gamma^- C' + R)^-1 eta``. ``upper_bound`` divides by
        ``C Pi^- C' + R``. ``off`` accepts everything and reports no detections.
    readmission
        The remedy against lock-out, see above.
    readmit_after
        Consecutive rejections of a sensor before its next packets get the second hearing.

    Raises
    ------
    ValueError
        When the plant or a sensor is not linear, a sensor's noise is singular, a weight is not positive or
        they sum to more than 1, or the readmission has nothing to work on.
    """

    listens: ClassVar[Listens] = "paired"

    def __init__(
        self,
        setting: Setting,
        *,
        coupling: Annotated[float, Ge(0.0), Lt(1.0)],
        threshold: Annotated[float, Gt(0.0)] = 25.0,
        detector: Literal["lower_bound", "upper_bound", "off"] = "lower_bound",
        readmission: Literal["none", "own_bound", "neighbours"] = "none",
        readmit_after: Annotated[int, Ge(1)] = 3,
    ) -> None:
        _check_weights(setting)
        _check_readmission(setting, detector, readmission)
        self.rounds = 1 if coupling > 0.0 or setting.neighbours else 0
        self._coupling = coupling
        self._threshold = threshold
        self._detector = detector
        self._readmission = readmission
        self._readmit_after = readmit_after
        self._dynamics = Dynamics(setting)
        self._sensors = SensorBank(setting)
        self._state = setting.plant.initial_mean
        self._upper = setting.plant.initial_covariance
        self._lower: LowerBound | None = None
        if detector == "lower_bound":
            self._lower = LowerBound(self._dynamics, self._sensors.models, self._upper, coupling)
        self._neighbourhood = Neighbourhood(setting, self._mixing)
        self._payload = np.empty(0)
        self._received = 0
        self._mixture: Matrix | None = None
        self._failures = dict.fromkeys(self._sensors.models, 0)
        self._clear_step()

    def correct(self, step: int, packets: Sequence[Packet]) -> Vector | None:
        """Predict from the step before, judge and use the measurements; return the payload (n + n * n)."""
        if step > 0:
            self._predict()
        self._clear_step()
        for packet in self._sensors.measurements(step, packets):
            self._take(packet)
        self._payload = np.concatenate((self._state, self._upper.ravel()))
        return self._payload

    def exchange(self, step: int, round_: int, packets: Sequence[Packet]) -> Vector | None:
        """Mix the neighbours' estimates and bounds with the node's own, for the next prediction."""
        self._received, self._mixture = self._neighbourhood.mix(step, self._payload, packets)
        return None

    def estimate(self, step: int) -> Belief:
        """Return the corrected state, its upper bound as covariance, and the verdicts of this step.

        Diagnostics: ``neighbours_received`` counts the neighbours that arrived; with a detector,
        ``detector_covariance_trace`` is the trace of what it divided by, summed over the packets, and
        ``readmitted`` counts the packets that the second hearing let in.
        """
        diagnostics = {"neighbours_received": float(self._received)}
        if self._detector != "off":
            diagnostics["detector_covariance_trace"] = self._detector_trace
            diagnostics["readmitted"] = float(self._readmitted)
        return Belief(
            self._state,
            self._upper,
            nis=self._nis,
            nis_dof=self._nis_dof,
            detections=self._detections,
            diagnostics=diagnostics,
        )

    def _clear_step(self) -> None:
        """Forget the verdicts of the step before."""
        self._nis = 0.0
        self._nis_dof = 0
        self._detector_trace = 0.0
        self._readmitted = 0
        self._detections: list[Detection] = []

    def _mixing(self, weights: Sequence[float]) -> Matrix:
        """Return the rows that make of the stacked payloads what a prediction needs.

        In this order: the state before ``A`` (7), the upper bound before ``A . A'`` (26), ``kappa Xi`` of
        (19), and the neighbours' own weighted mean.
        """
        kappa = self._coupling
        spread = np.full(len(weights) + 1, 2.0 * kappa)
        upper = (1.0 + kappa) * spread
        upper[0] += 1.0 + kappa
        mean = np.array([0.0, *weights]) / sum(weights)
        return np.array([state_mixing(kappa, weights), upper, spread, mean])

    def _predict(self) -> None:
        """Predict the state (7) and both bounds (17), (26)."""
        state, upper, deduction = self._state, self._upper, None
        n = len(state)
        if self._mixture is not None and self._coupling > 0.0:
            state = self._mixture[0, :n]
            upper = self._mixture[1, n:].reshape(n, n)
            deduction = self._mixture[2, n:].reshape(n, n)
        if self._lower is not None:
            self._lower.predict(deduction)
        self._state = self._dynamics.A.dot(state)
        self._upper = self._dynamics.propagate(upper)

    def _take(self, packet: Packet) -> None:
        """Judge a packet, and correct by it when it is accepted (34), (35)."""
        model = self._sensors.models[packet.source]
        correction = correct(self._state, self._upper, model, packet.values)
        self._nis += correction.nis
        self._nis_dof += len(packet.values)
        if self._detector == "off" or self._accepts(packet, correction):
            self._state, self._upper = correction.state, correction.covariance

    def _accepts(self, packet: Packet, correction: Correction) -> bool:
        """Give the verdict on a packet, note it, and let the lower bound pass the measurement (18), (25)."""
        source = packet.source
        if self._lower is None:
            factor, statistic = correction.factor, correction.nis
        else:
            factor = self._lower.innovation_factor(source)
            statistic = mahalanobis_squared(correction.innovation, factor)
            self._lower.correct(source, correction)
        self._detector_trace += float(np.vdot(factor, factor))
        accepted = statistic < self._threshold
        if accepted:
            self._failures[source] = 0
        else:
            accepted = self._failures[source] >= self._readmit_after and self._readmits(packet, correction)
            self._readmitted += accepted
            self._failures[source] += 1
        self._detections.append(Detection(source, packet.sequence, statistic, not accepted))
        return accepted

    def _readmits(self, packet: Packet, correction: Correction) -> bool:
        """Give a packet that failed the detector its second hearing."""
        if self._readmission == "own_bound":
            return correction.nis < self._threshold
        if self._readmission == "neighbours" and self._mixture is not None:
            n = len(self._state)
            C, R = self._sensors.models[packet.source]
            innovation = packet.values - C.dot(self._dynamics.A.dot(self._mixture[3, :n]))
            bound = self._dynamics.propagate(self._mixture[3, n:].reshape(n, n))
            return mahalanobis_squared(innovation, cholesky(C.dot(bound).dot(C.T) + R)) < self._threshold
        return False


def _check_weights(setting: Setting) -> None:
    """Raise ValueError unless the weights are those that the bounds assume."""
    weights = setting.neighbours.values()
    if any(weight <= 0.0 for weight in weights) or sum(weights) > 1.0 + 1e-9:
        raise ValueError(
            f"{setting.name}: the weights {dict(setting.neighbours)} must be positive "
            "and sum to at most 1; use 1 / degree"
        )


def _check_readmission(setting: Setting, detector: str, readmission: str) -> None:
    """Raise ValueError when the readmission has nothing to work on."""
    if readmission == "none":
        return
    if detector == "off":
        raise ValueError(f"{setting.name}: detector 'off' rejects nothing, so set readmission to 'none'")
    if readmission == "own_bound" and detector == "upper_bound":
        raise ValueError(f"{setting.name}: readmission 'own_bound' repeats detector 'upper_bound'; drop one")
    if readmission == "neighbours" and not setting.neighbours:
        raise ValueError(f"{setting.name}: readmission 'neighbours' needs neighbours; use 'own_bound'")
