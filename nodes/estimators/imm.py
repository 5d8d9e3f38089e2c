"""The interacting multiple model filter with two modes, without and with attack (Blom, Bar-Shalom 1988)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, ClassVar, Literal

import numpy as np
from annotated_types import Interval

from bus.packets import Packet, Vector
from nodes.contract import Belief, Setting
from nodes.estimators.attack_model import AttackModel
from nodes.estimators.attack_prior import AttackLaw, prior_mixture
from nodes.estimators.commanded_input import CommandedInput
from nodes.estimators.gaussian_mixture import Mixture, joined, merge, moments
from nodes.estimators.hybrid_density import (
    Density,
    Origin,
    Reduction,
    Switching,
    correct_density,
    predict,
    predict_without_feedthrough,
    settle,
    start,
)
from nodes.estimators.packet_sets import packet_sets, pooled

Probability = Annotated[float, Interval(ge=0.0, le=1.0)]
_EVERYTHING = math.inf
_GENUINE = Origin(-math.inf, np.zeros(1))
_ONE_EACH = Reduction(0.0, _EVERYTHING, 1)


class Imm:
    """Two Kalman filters, one of which sees the attack's signal as noise of law ``attack_prior``.

    Before every prediction the laws of both modes are mixed into one Gaussian for each. The filter knows of
    no fakes: every packet of a sensor is a measurement. It publishes mean and covariance of the mixture.

    Parameters
    ----------
    setting
        Linear models.
    attack_prior
        Law of the signal under attack, drawn anew in every step.
    attack_birth, attack_survival
        Probabilities that an attack begins, or lasts, from one step to the next.
    initial_attack_probability
        Probability of an attack before the first measurement.
    feedthrough
        Whether the signal of a step shows in that step's measurements.

    Raises
    ------
    ValueError
        When a model is not linear, or some direction of the signal shows in no measurement.
    """

    listens: ClassVar[Literal["paired", "all"]] = "paired"
    rounds: int = 0

    def __init__(
        self,
        setting: Setting,
        *,
        attack_prior: AttackLaw,
        attack_birth: Probability,
        attack_survival: Probability,
        initial_attack_probability: Probability = 0.1,
        feedthrough: bool = True,
    ) -> None:
        self._prior = prior_mixture([attack_prior], setting.name)
        self._model = AttackModel(setting, self._prior.means.shape[1], "linear", feedthrough)
        self._sizes = {name: len(sensor.noise) for name, sensor in self._model.sensors.items()}
        self._feedthrough = feedthrough
        self._switching = Switching(attack_birth, attack_survival)
        self._initial_probability = initial_attack_probability
        self._input = CommandedInput(setting.plant)
        plant = setting.plant
        at_start = initial_attack_probability if feedthrough else 0.0
        self._density = start(plant.initial_mean, plant.initial_covariance, self._prior, at_start)
        self._nis = 0.0
        self._nis_dof = 0

    def control(self, step: int, packets: Sequence[Packet]) -> None:
        """Take the input that was commanded in ``step``, for the prediction that follows."""
        self._input.take(packets)

    def correct(self, step: int, packets: Sequence[Packet]) -> Vector | None:
        """Mix and predict, then correct both modes by this step's packets; nothing is sent."""
        density = self._mixed(step) if step > 0 else self._density
        self._nis, self._nis_dof = 0.0, 0
        for source, members in packet_sets(step, packets, self._sizes).items():
            sensor = self._model.sensors[source]
            measured = pooled(members, sensor.noise)
            density, seen = correct_density(
                density,
                sensor,
                measured.values[None],
                _GENUINE,
                n=self._model.n,
                unknown=False,
                reduction=_ONE_EACH,
                noise=measured.noise,
            )
            self._nis += seen.nis + measured.scatter
            self._nis_dof += seen.nis_dof + measured.scatter_dof
        self._density = settle(density, _ONE_EACH)
        return None

    def exchange(self, step: int, round_: int, packets: Sequence[Packet]) -> Vector | None:
        """Do nothing: the filter works alone."""
        return None

    def estimate(self, step: int) -> Belief:
        """Return mean and covariance over both modes.

        NIS is that of the likelier mode. Diagnostics: ``attack_probability``, and as in `HybridBernoulli`
        the signal ``a0``, ... with ``a0_sigma``, ... of the step ``attack_step``.
        """
        n = self._model.n
        safe, attacked = self._density
        marginal = Mixture(attacked.log_weights, attacked.means[:, :n], attacked.covariances[:, :n, :n])
        state, covariance = moments(joined(safe, marginal))
        signal, spread = self._prior.means[0], self._prior.covariances[0]
        if attacked.size:
            signal, spread = attacked.means[0, n:], attacked.covariances[0, n:, n:]
        diagnostics = {
            "attack_probability": self._density.attack_probability(),
            "attack_step": float(step if self._feedthrough else step - 1),
        }
        diagnostics |= {f"a{i}": value for i, value in enumerate(signal.tolist())}
        sigma = np.sqrt(np.maximum(spread.diagonal(), 0.0))
        diagnostics |= {f"a{i}_sigma": value for i, value in enumerate(sigma.tolist())}
        return Belief(state, covariance, nis=self._nis, nis_dof=self._nis_dof, diagnostics=diagnostics)

    def _mixed(self, step: int) -> Density:
        """Return the predicted laws, of one component for each mode."""
        if self._feedthrough:
            predicted = predict(self._density, self._model, self._prior, self._switching, self._input.effect)
        else:
            birth = self._initial_probability if step == 1 else self._switching.birth
            switching = self._switching._replace(birth=birth)
            predicted = predict_without_feedthrough(
                self._density, self._model, self._prior, switching, self._input.effect
            )
        safe, attacked = predicted
        entry, free = attacked.entry, attacked.free
        one = merge(attacked, _EVERYTHING)
        return Density(
            merge(safe, _EVERYTHING),
            one._replace(
                entry=None if entry is None else entry[: one.size],
                free=None if free is None else free[: one.size],
            ),
        )
