"""The Kalman filter with probabilistic data association: fakes, but no signal (Bar-Shalom, Tse 1975)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bus.packets import Packet, Vector
from bus.quantities import Probability
from nodes.contract import Detection, Setting
from nodes.estimators.commanded_input import Commanded, CommandedInput
from nodes.estimators.gaussian_mixture import Mixture, log_sum, moments
from nodes.estimators.hybrid_density import injection
from nodes.estimators.joint_input_state import Linearised, correct
from nodes.estimators.linear_gaussian import Dynamics, SensorBank
from nodes.estimators.packet_sets import FakeBox, packet_sets
from nodes.estimators.solitary import SolitaryGaussian


class ProbabilisticDataAssociation(Commanded, SolitaryGaussian):
    """A Kalman filter that weighs which packet of a sensor is genuine, if any, and keeps one Gaussian.

    Of the n packets of a sensor each is the genuine one with a weight of ``p_d l(y) / (n kappa)``, and none
    is with ``1 - p_d``; there is no gate. The law after it has the moments of this mixture. Sensors are taken
    one after the other. The NIS is that of the likeliest packet of each sensor.

    Parameters
    ----------
    setting
        Linear models.
    fakes
        Where fakes are believed to lie: a box, over which their density ``kappa`` is constant.
    delivery
        Probability ``p_d`` that the genuine packet arrives.

    Raises
    ------
    ValueError
        When a model is not linear, or a sensor's noise is singular.
    """

    _detections: list[Detection]

    def __init__(
        self,
        setting: Setting,
        *,
        fakes: FakeBox,
        delivery: Probability = 1.0,
    ) -> None:
        self._dynamics = Dynamics(setting)
        self._models = SensorBank(setting).models
        super().__init__(setting)
        self._sizes = {name: len(model.C) for name, model in self._models.items()}
        self._fakes = {name: fakes.law(size) for name, size in self._sizes.items()}
        self._delivery = delivery
        self._input = CommandedInput(setting.plant)

    def correct(self, step: int, packets: Sequence[Packet]) -> Vector | None:
        """Predict from the step before, then correct by this step's packets; nothing is sent."""
        if step > 0:
            self._state = self._input.add_to(self._dynamics.A.dot(self._state))
            self._covariance = self._dynamics.propagate(self._covariance)
        self._nis, self._nis_dof, self._detections = 0.0, 0, []
        for source, members in packet_sets(step, packets, self._sizes).items():
            self._take(source, members)
        return None

    def _take(self, source: str, members: Sequence[Packet]) -> None:
        """Correct by the packets of one sensor."""
        C, R = self._models[source]
        prior = Mixture(np.zeros(1), self._state[None], self._covariance[None])
        values = np.array([packet.values for packet in members])
        found = correct(prior, Linearised(C.dot(self._state)[None], C[None]), R, values, unknown=False)
        origin = injection(self._delivery, self._fakes[source].log_densities(values))
        log_weights = np.append(origin.none, origin.genuine + found.log_likelihoods[0])
        total = log_sum(log_weights)
        if total == -np.inf:
            self._detections += [Detection(p.source, p.sequence, 1.0, True) for p in members]
            return
        means = np.concatenate((prior.means, self._state + found.innovations[0].dot(found.gain[0].T)))
        covariances = np.concatenate(
            (prior.covariances, np.broadcast_to(found.covariances, (len(members), *C.shape[1:] * 2)))
        )
        possible = log_weights > -np.inf
        self._state, self._covariance = moments(
            Mixture(log_weights[possible], means[possible], covariances[possible])
        )
        fake = np.clip(1.0 - np.exp(log_weights[1:] - total), 0.0, 1.0)
        best = int(log_weights.argmax())
        if best:
            self._nis += float(found.nis[0, best - 1])
            self._nis_dof += len(R)
        self._detections += [
            Detection(p.source, p.sequence, one, one > 0.5)
            for p, one in zip(members, fake.tolist(), strict=True)
        ]
