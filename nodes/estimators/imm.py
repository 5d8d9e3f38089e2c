"""The interacting multiple model filter with two modes, without and with attack (Blom, Bar-Shalom 1988)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from bus.packets import Packet, Vector
from bus.quantities import Probability
from nodes.contract import Belief, Setting
from nodes.estimators.attack_prior import AttackLaw
from nodes.estimators.gaussian_mixture import Mixture, joined, merge, moments
from nodes.estimators.hybrid_density import (
    Density,
    Origin,
    Reduction,
    Switching,
    correct_density,
    settle,
)
from nodes.estimators.hybrid_filter import HybridFilter, signal_diagnostics
from nodes.estimators.packet_sets import packet_sets, pooled

_EVERYTHING = math.inf
_GENUINE = Origin(-math.inf, np.zeros(1))
_ONE_EACH = Reduction(0.0, _EVERYTHING, 1)


class Imm(HybridFilter):
    """Two Kalman filters, one of which sees the attack's signal as noise of law ``attack_prior``.

    Before every prediction the laws of both modes are mixed into one Gaussian for each. The filter knows of
    no fakes: every packet of a sensor is a measurement. It publishes mean and covariance of the mixture.

    Parameters
    ----------
    setting
        Linear models.
    attack_prior
        Law of the signal under attack, drawn anew in every step.
    attack_birth
        Probability that an attack begins from one step to the next.
    attack_survival
        Probability that an attack lasts from one step to the next.
    initial_attack_probability
        Probability of an attack before the first measurement.
    feedthrough
        Whether the signal of a step shows in that step's measurements.

    Raises
    ------
    ValueError
        When a model is not linear, or some direction of the signal shows in no measurement.
    """

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
        super().__init__(
            setting,
            [attack_prior],
            feedthrough=feedthrough,
            switching=Switching(attack_birth, attack_survival),
            initial_attack_probability=initial_attack_probability,
        )
        self._nis = 0.0
        self._nis_dof = 0

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

    def estimate(self, step: int) -> Belief:
        """Return mean and covariance over both modes.

        NIS is that of the likelier mode. Diagnostics: ``attack_probability``, and as in `HybridBernoulli`
        the signal ``a0``, ... with ``a0_sigma``, ... of the step ``attack_step``.
        """
        n = self._model.n
        safe, attacked = self._density
        marginal = Mixture(attacked.log_weights, attacked.means[:, :n], attacked.covariances[:, :n, :n])
        state, covariance = moments(joined(safe, marginal))
        diagnostics = {
            "attack_probability": self._density.attack_probability(),
            "attack_step": self._attack_step(step),
            **signal_diagnostics(*self._only_signal()),
        }
        return Belief(state, covariance, nis=self._nis, nis_dof=self._nis_dof, diagnostics=diagnostics)

    def _mixed(self, step: int) -> Density:
        """Return the predicted laws, of one component for each mode."""
        safe, attacked = self._predicted(step)
        entry, free = attacked.entry, attacked.free
        one = merge(attacked, _EVERYTHING)
        return Density(
            merge(safe, _EVERYTHING),
            one._replace(
                entry=None if entry is None else entry[: one.size],
                free=None if free is None else free[: one.size],
            ),
        )
