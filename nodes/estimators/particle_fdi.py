"""The particle filter that detects false data and takes it out (Sadeghzadeh-Nokhodberiz et al. 2022)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, Interval
from msgspec.structs import replace

from bus.packets import ORACLE, Packet, Vector
from nodes.contract import (
    Belief,
    Detection,
    LikelihoodSensor,
    Matrix,
    NonlinearPlant,
    NonlinearSensor,
    Setting,
)
from nodes.estimators.attack_detection import UpdatedParticles, WeightedResiduals
from nodes.estimators.attack_estimate import AttackEstimate, ConvergingBiasTracker, ToldAttack
from nodes.estimators.particle import Particle
from nodes.estimators.particle_moments import Moments
from nodes.estimators.resampling import Scheme


class ParticleFdi(Particle):
    """A particle filter with a detector for false data on each sensor, and a compensation for what it finds.

    In each step, for each packet (Table 2): the detector makes a statistic ``beta`` of the particles and
    raises an alarm when it exceeds ``zeta = alpha (N - 1) / N`` (46); on an alarm the estimate of the attack
    is taken off the measurement, and the particles, moved by the plant alone, are weighed by what is left
    (59), (60). Each sensor is judged for itself; a sensor with several outputs is attacked as a whole.

    ``attack_estimate`` says where the estimate of the attack comes from. ``kalman`` tracks it from the alarms
    of the filter itself. The paper assumes that it is known: ``oracle`` is the adversary's own word, and
    ``noisy_oracle`` the same with noise. Both are privileges that the topology must grant. The filter as
    published is ``{resampling: none, attack_estimate: oracle, particles: 100}``.

    Parameters
    ----------
    setting
        A plant that can be sampled and has a process noise covariance, and sensors with likelihood, Jacobian
        and noise covariance. The detector's gain is made at the initial mean.
    minimum_attack
        Smallest norm of an attack on a sensor that shall be detected, in units of the measurement; it makes
        the threshold ``eta`` of the residuals (45). Attacks below may pass.
    threshold
        ``eta`` itself, instead.
    occurrence
        The probability ``p`` that the adversary falsifies a packet: the least that ``zeta`` may be (53).
    alpha
        Makes ``zeta`` larger than ``p``, at most 1; ``p N / (N - 1)`` when not given.
    detector
        ``updated_particles`` is the paper's modified detector, ``weighted_residuals`` that of the normal
        filter, which it is compared with.
    attack_estimate
        The source of the attack's estimate.
    attack_pole
        What ``kalman`` assumes of an attack: the pole by which it approaches its target.
    attack_target_std
        Likewise, the prior standard deviation of that target.
    attack_wander_std
        Likewise, the standard deviation of the noise that attack and target are allowed each step.
    oracle_std
        Standard deviation of the noise of ``noisy_oracle``.
    particles, resampling, resample_below
        As for `particle`.

    Raises
    ------
    ValueError
        When the plant or a sensor lacks what is needed, alpha is below what (53) asks, or the topology does
        not grant the oracle.
    """

    def __init__(
        self,
        setting: Setting,
        *,
        minimum_attack: Annotated[float, Gt(0.0)],
        threshold: Annotated[float, Gt(0.0)] | None = None,
        occurrence: Annotated[float, Interval(gt=0.0, lt=1.0)] = 0.5,
        alpha: Annotated[float, Interval(gt=0.0, le=1.0)] | None = None,
        detector: Literal["updated_particles", "weighted_residuals"] = "updated_particles",
        attack_estimate: Literal["kalman", "oracle", "noisy_oracle"] = "kalman",
        attack_pole: Annotated[float, Interval(ge=0.0, lt=1.0)] = 0.9,
        attack_target_std: Annotated[float, Gt(0.0)] = 1.0,
        attack_wander_std: Annotated[float, Ge(0.0)] = 1e-3,
        oracle_std: Annotated[float, Gt(0.0)] = 0.1,
        particles: Annotated[int, Ge(2)] = 1000,
        resampling: Scheme = "systematic",
        resample_below: Annotated[float, Interval(ge=0.0, le=1.0)] = 0.5,
    ) -> None:
        super().__init__(setting, particles=particles, resampling=resampling, resample_below=resample_below)
        if attack_estimate != "kalman" and not setting.told_attacks:
            raise ValueError(
                f"{setting.name}: attack_estimate '{attack_estimate}' is a privilege that the topology does "
                f"not grant; use 'kalman', or name the attacks in 'oracles: {{{setting.name}: [...]}}'"
            )
        self._zeta = _alarm_threshold(setting.name, occurrence, alpha, particles)
        self._detectors: dict[str, UpdatedParticles | WeightedResiduals] = {}
        self._attacks: dict[str, AttackEstimate] = {}
        self._noise_variance: dict[str, Vector] = {}
        for name, sensor in self._sensors.items():
            updated = _modified_detector(setting, name, sensor, minimum_attack, threshold)
            weighted = detector == "weighted_residuals"
            self._detectors[name] = (
                WeightedResiduals(sensor, threshold=updated.threshold) if weighted else updated
            )
            self._noise_variance[name] = np.diag(getattr(sensor, "R", np.empty((0, 0)))).copy()
            size = self._sizes[name]
            if attack_estimate == "kalman":
                self._attacks[name] = ConvergingBiasTracker(
                    size, pole=attack_pole, target_std=attack_target_std, wander_std=attack_wander_std
                )
            else:
                std = oracle_std if attack_estimate == "noisy_oracle" else 0.0
                self._attacks[name] = ToldAttack(size, noise_std=std, rng=self._own)
        self._labels = [
            tuple([f"{what}_{name}_{i}" for i in range(size)] for what in ("attack", "attack_variance"))
            for name, size in self._sizes.items()
        ]
        self.takes_oracles = attack_estimate != "kalman"
        self._detections: list[Detection] = []

    def correct(self, step: int, packets: Sequence[Packet]) -> Vector | None:
        """Move the particles and the attack's estimates, then judge and use this step's measurements."""
        self._detections = []
        told = {packet.source: packet.values for packet in packets if packet.kind == ORACLE}
        if step > 0 or self.takes_oracles:
            for name, attack in self._attacks.items():
                attack.predict(told.get(name))
        return super().correct(step, [packet for packet in packets if packet.kind != ORACLE])

    def estimate(self, step: int) -> Belief:
        """Return the belief of the particles and this step's verdicts.

        Diagnostics, beside those of `particle`: for each component i of each sensor, ``attack_{sensor}_{i}``
        is the estimate of the attack, in steps without alarm too, and ``attack_variance_{sensor}_{i}`` its
        error variance.
        """
        return replace(super().estimate(step), detections=self._detections)

    def _diagnostics(self) -> dict[str, float]:
        found = super()._diagnostics()
        for (values, variances), attack in zip(self._labels, self._attacks.values(), strict=True):
            found.update(zip(values, attack.value.tolist(), strict=True))
            found.update(zip(variances, attack.variance.tolist(), strict=True))
        return found

    def _log_likelihood(self, packet: Packet, predicted: Matrix, own: Moments) -> Vector:
        """Judge a packet, compensate it if it was attacked, and return the log-likelihood (N,) of it."""
        name, values, sensor = packet.source, packet.values, self._sensors[packet.source]
        statistic = self._detectors[name].statistic(values, self._states, predicted)
        alarm = statistic > self._zeta
        self._detections.append(Detection(name, packet.sequence, statistic, alarm))
        if alarm:
            attack = self._attacks[name]
            if not self.takes_oracles:
                spread = own.covariance.diagonal()
                attack.update(values - own.mean, self._noise_variance[name] + spread)
            values = values - attack.value
        return sensor.log_likelihood(values, predicted)


def _alarm_threshold(name: str, occurrence: float, alpha: float | None, particles: int) -> float:
    """Return ``zeta`` (46); raises ValueError when alpha is below what (53) asks."""
    least = occurrence * particles / (particles - 1)
    if alpha is None:
        return occurrence
    if alpha < least:
        raise ValueError(f"{name}: alpha is {alpha}, below p N / (N - 1) = {least:.6g}; leave it out")
    return alpha * (particles - 1) / particles


def _modified_detector(
    setting: Setting, name: str, sensor: LikelihoodSensor, minimum_attack: float, threshold: float | None
) -> UpdatedParticles:
    """Return a sensor's detector; raises ValueError when its models do not tell its gain."""
    if not isinstance(setting.plant, NonlinearPlant):
        kind = type(setting.plant).__name__
        raise ValueError(
            f"{setting.name}: plant {kind} has no 'Q'; use a plant that satisfies NonlinearPlant"
        )
    if not isinstance(sensor, NonlinearSensor):
        raise ValueError(
            f"{setting.name}: sensor {name} ({type(sensor).__name__}) has no 'jacobian' and 'R'; "
            "use a sensor that satisfies NonlinearSensor"
        )
    return UpdatedParticles(
        sensor,
        setting.plant.Q,
        setting.plant.initial_mean,
        minimum_attack=minimum_attack,
        threshold=threshold,
    )
