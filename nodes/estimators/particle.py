"""The particle filter: any plant that can be drawn from, any sensor that has a likelihood."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from annotated_types import Ge, Interval

from bus.packets import Packet, Vector
from bus.random_streams import sequential_streams
from nodes.contract import Belief, LikelihoodSensor, Matrix, SampledPlant, Setting
from nodes.estimators.arrivals import measurements
from nodes.estimators.commanded_input import Commanded, CommandedInput
from nodes.estimators.linear_gaussian import refuse_innovations
from nodes.estimators.particle_moments import (
    Moments,
    moments,
    normalised_innovation_squared,
    stacked_noise,
)
from nodes.estimators.resampling import SCHEMES, Scheme, effective_sample_size
from nodes.estimators.solitary import Solitary


class Particle(Commanded, Solitary):
    """A particle filter that draws from the plant and weighs by the sensors' likelihoods.

    Without resampling it is sequential importance sampling (SIS; Sadeghzadeh-Nokhodberiz 2022, eqs (5)-(7)),
    whose weights all go to one particle sooner or later. With resampling (SIR) the particles are drawn anew
    before a prediction, when their effective number has fallen below a share of N (Doucet, Johansen 2009).
    The estimate is made before resampling, which only adds variance.

    Weights are kept as logarithms, so that no measurement, however far off, makes all of them vanish. The
    draws of the plant's noise and those of resampling have streams of their own, and do not depend on what
    is measured: two filters of one seed move the same particles in the same way until one resamples. The
    published covariance is that of the weighted particles: it knows nothing of the Monte Carlo error, and
    is singular when one of them has all the weight.

    Parameters
    ----------
    setting
        A plant that can be sampled, and sensors with a likelihood.
    particles
        Number ``N`` of particles.
    resampling
        ``none``, or the scheme: ``systematic``, ``stratified`` or ``residual``.
    resample_below
        The share of N below which the effective sample size calls for resampling; 1 does so in every step.

    Raises
    ------
    ValueError
        When the plant cannot be sampled, or a sensor has no likelihood.
    """

    def __init__(
        self,
        setting: Setting,
        *,
        particles: Annotated[int, Ge(2)] = 1000,
        resampling: Scheme = "systematic",
        resample_below: Annotated[float, Interval(ge=0.0, le=1.0)] = 0.5,
    ) -> None:
        self._plant = sampled_plant(setting)
        self._sensors = likelihood_sensors(setting)
        mean = setting.plant.initial_mean[None]
        self._sizes = {name: sensor.measure(mean).shape[1] for name, sensor in self._sensors.items()}
        least = self.least_particles(len(mean[0]))
        if particles < least:
            raise ValueError(f"{setting.name}: {particles} particles are too few; give at least {least}")
        self._noises: dict[str, Matrix | None] = {
            name: getattr(sensor, "R", None) for name, sensor in self._sensors.items()
        }
        self._input = CommandedInput(setting.plant)
        self._number = particles
        self._resample = SCHEMES.get(resampling)
        self._enough = resample_below * particles
        self._noise, self._choice, self._own = sequential_streams(setting.rng, 3)
        self._states: Matrix = np.empty((0, 0))
        self._equal: Vector = np.full(particles, 1.0 / particles)
        self._weights = self._equal
        self._log_weights: Vector = np.zeros(particles)
        self._resampled = False
        self._nis = 0.0
        self._nis_dof = 0

    @staticmethod
    def least_particles(n: int) -> int:
        """Return the number of particles that the method needs for a state of n components."""
        return 2

    def correct(self, step: int, packets: Sequence[Packet]) -> Vector | None:
        """Move the particles, then weigh them by this step's measurements; nothing is sent."""
        if step == 0:
            self._states = self._plant.sample_initial(self._number, self._noise)
        else:
            self._move()
        self._nis, self._nis_dof = 0.0, 0
        current = measurements(step, packets, self._sizes)
        if current:
            self._weigh(current)
        return None

    def estimate(self, step: int) -> Belief:
        """Return the mean and the covariance of the weighted particles, and the NIS of the measurements.

        The NIS takes the packets as they came, and what the particles predicted of them; there is none when
        a sensor has no noise covariance ``R``.

        Diagnostics: ``effective_sample_size``, and whether the particles were ``resampled`` in this step.
        """
        mean, covariance = moments(self._weights, self._states)
        return Belief(mean, covariance, nis=self._nis, nis_dof=self._nis_dof, diagnostics=self._diagnostics())

    def _diagnostics(self) -> dict[str, float]:
        return {
            "effective_sample_size": effective_sample_size(self._weights),
            "resampled": float(self._resampled),
        }

    def _move(self) -> None:
        """Resample if there is need, and draw the particles' successors."""
        self._resampled = self._resample is not None and effective_sample_size(self._weights) < self._enough
        if self._resampled and self._resample is not None:
            chosen = self._resample(self._weights, self._choice)
            self._states = self._states.T.take(chosen, axis=1).T
            self._weights = self._equal
            self._log_weights.fill(0.0)
        self._states = self._input.add_to(self._plant.sample(self._states, self._noise))

    def _weigh(self, packets: Sequence[Packet]) -> None:
        """Weigh the particles by at least one packet of this step (6)."""
        predictions = [self._sensors[packet.source].measure(self._states) for packet in packets]
        whole = moments(self._weights, predictions[0] if len(packets) == 1 else np.hstack(predictions))
        noises = [self._noises[packet.source] for packet in packets]
        known = [noise for noise in noises if noise is not None]
        if len(known) == len(packets):
            values = np.concatenate([packet.values for packet in packets])
            self._nis = normalised_innovation_squared(values, whole, stacked_noise(known))
            self._nis_dof = values.size
        end = 0
        for packet, predicted in zip(packets, predictions, strict=True):
            begin, end = end, end + packet.values.size
            own = Moments(whole.mean[begin:end], whole.covariance[begin:end, begin:end])
            self._multiply(self._log_likelihood(packet, predicted, own))
        self._normalise()

    def _log_likelihood(self, packet: Packet, predicted: Matrix, own: Moments) -> Vector:
        """Return the log-likelihood (N,) of a packet; ``own`` are the moments of its prediction (N, m)."""
        return self._sensors[packet.source].log_likelihood(packet.values, predicted)

    def _multiply(self, log_likelihood: Vector) -> None:
        """Multiply the weights by a likelihood (N,); one that is zero everywhere tells nothing."""
        peak = log_likelihood.max()
        if peak > -np.inf:
            self._log_weights += log_likelihood
            self._log_weights -= peak

    def _normalise(self) -> None:
        """Make the weights of their logarithms, so that they sum to 1."""
        self._log_weights -= self._log_weights.max()
        self._weights = np.exp(self._log_weights)
        self._weights /= self._weights.sum()


def sampled_plant(setting: Setting) -> SampledPlant:
    """Return the setting's plant; raises ValueError when it cannot be sampled."""
    if not isinstance(setting.plant, SampledPlant):
        raise ValueError(
            f"{setting.name}: plant {type(setting.plant).__name__} has no 'sample' and 'sample_initial'; "
            "use a plant that satisfies SampledPlant"
        )
    return setting.plant


def likelihood_sensors(setting: Setting) -> dict[str, LikelihoodSensor]:
    """Return the setting's sensors; raises ValueError for one that has no likelihood."""
    models: dict[str, LikelihoodSensor] = {}
    for name, sensor in setting.sensors.items():
        if not isinstance(sensor, LikelihoodSensor):
            raise ValueError(
                f"{setting.name}: sensor {name} ({type(sensor).__name__}) has no 'measure' and "
                "'log_likelihood'; use a sensor that satisfies LikelihoodSensor"
            )
        refuse_innovations(setting, name)
        predicted = sensor.measure(setting.plant.initial_mean[None])
        sensor.log_likelihood(predicted[0], predicted)
        models[name] = sensor
    return models
