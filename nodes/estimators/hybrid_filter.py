"""What the filters of attack and state share: their models, the joint law and its prediction."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bus.packets import Vector
from nodes.contract import Matrix, Setting
from nodes.estimators.attack_model import AttackModel, MomentRule
from nodes.estimators.attack_prior import AttackLaw, prior_mixture
from nodes.estimators.commanded_input import Commanded, CommandedInput
from nodes.estimators.hybrid_density import (
    Density,
    Switching,
    predict,
    predict_without_feedthrough,
    start,
)
from nodes.estimators.solitary import Solitary


class HybridFilter(Commanded, Solitary):
    """A filter of the joint law of attack and state, which corrects and publishes in a way of its own.

    Parameters
    ----------
    setting
        The node's models.
    attack_prior
        Law of the signal, as one or several Gaussian components.
    moments
        How the models are linearised (`AttackModel`).
    feedthrough
        Whether the signal of a step shows in that step's measurements.
    switching
        How attacks come and go.
    initial_attack_probability
        Probability of an attack before the first measurement.

    Raises
    ------
    ValueError
        When the models do not fit one another, or some direction of the signal shows in no measurement.
    """

    def __init__(
        self,
        setting: Setting,
        attack_prior: Sequence[AttackLaw],
        *,
        moments: MomentRule = "linear",
        feedthrough: bool,
        switching: Switching,
        initial_attack_probability: float,
    ) -> None:
        self._prior = prior_mixture(attack_prior, setting.name)
        self._model = AttackModel(setting, self._prior.means.shape[1], moments, feedthrough)
        self._sizes = {name: len(sensor.noise) for name, sensor in self._model.sensors.items()}
        self._input = CommandedInput(setting.plant)
        self._feedthrough = feedthrough
        self._switching = switching
        self._initial_probability = initial_attack_probability
        plant = setting.plant  # without feedthrough no step was before step 0 of which to find the attack
        at_start = initial_attack_probability if feedthrough else 0.0
        self._density = start(plant.initial_mean, plant.initial_covariance, self._prior, at_start)

    def _predicted(self, step: int) -> Density:
        """Return the law of ``step``, before its packets, from that of the step before."""
        if self._feedthrough:
            return predict(self._density, self._model, self._prior, self._switching, self._input.effect)
        birth = self._initial_probability if step == 1 else self._switching.birth
        switching = self._switching._replace(birth=birth)
        return predict_without_feedthrough(
            self._density, self._model, self._prior, switching, self._input.effect
        )

    def _attack_step(self, step: int) -> float:
        """Return the step to which the signal belongs that is estimated in ``step``."""
        return float(step if self._feedthrough else step - 1)

    def _only_signal(self) -> tuple[Vector, Matrix]:
        """Return the signal (q,) and its covariance (q, q), of a law that has one component a mode."""
        n, attacked = self._model.n, self._density.attacked
        if attacked.size:
            return attacked.means[0, n:], attacked.covariances[0, n:, n:]
        return self._prior.means[0], self._prior.covariances[0]


def signal_diagnostics(signal: Vector, covariance: Matrix) -> dict[str, float]:
    """Return the signal (q,) as ``a0``, ..., and its standard deviations as ``a0_sigma``, ...."""
    sigma = np.sqrt(np.maximum(covariance.diagonal(), 0.0))
    found = {f"a{i}": value for i, value in enumerate(signal.tolist())}
    return found | {f"a{i}_sigma": value for i, value in enumerate(sigma.tolist())}
