"""The hybrid Bernoulli filter of Forti, Battistelli, Chisci, Sinopoli 2019: attack and state, jointly."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, MinLen

from bus.packets import Packet, Vector
from bus.quantities import Probability
from nodes.contract import Belief, Detection, Matrix, Setting
from nodes.estimators.attack_model import MomentRule
from nodes.estimators.attack_prior import AttackLaw
from nodes.estimators.gaussian_mixture import Mixture, joined, moments
from nodes.estimators.hybrid_density import (
    Origin,
    Reduction,
    Seen,
    Switching,
    correct_density,
    injection,
    settle,
    substitution,
)
from nodes.estimators.hybrid_filter import HybridFilter, signal_diagnostics
from nodes.estimators.packet_sets import FakeBox, packet_sets


class HybridBernoulli(HybridFilter):
    """A Bayesian filter of the joint law of attack and state, as two Gaussian mixtures (Forti et al. 2019).

    The plant is ``x+ = A x + G a + w`` and a sensor measures ``y = C x + H a + v``, where ``a`` acts while
    there is an attack. The filter carries the probability ``r`` of an attack, the law of the state without
    one and the joint law of signal and state under one. It expects fake packets: a lone packet of a sensor
    may have replaced the genuine one (Proposition 1), and among several at most one is genuine (Proposition
    2). Components that survive pruning at ``pruning`` are merged at ``merging``.

    The prior of step 0 is the plant's initial law, beside the prior of the signal.

    **Several sensors** are taken one after the other. Their noises and links are independent, so that the
    likelihood of the whole is the product, and the order does not matter for ``bayes``. For ``jise`` each
    component keeps book of the directions of the signal that the packets so far have fixed; see
    `nodes.estimators.joint_input_state`. A direction that none of the packets that came shows keeps its
    prior.

    Parameters
    ----------
    setting
        The node's models.
    attack_prior
        Law ``p(a)`` of the signal, in its units, as one or several Gaussian components.
    fakes
        Where fakes are believed to lie: a box in the units of a measurement, over which their density is
        constant; outside too, unless it is ``hard``.
    attack_birth
        Probability ``p_b`` that an attack begins from one step to the next.
    attack_survival
        Probability ``p_s`` that an attack lasts from one step to the next.
    initial_attack_probability
        ``r`` before the first measurement.
    delivery
        Probability ``p_d`` that the genuine packet arrives.
    substitution
        Probability ``p_f`` that a lone packet is a fake in place of the genuine one.
    correction
        ``by_arrival``: Proposition 1 for a lone packet of a sensor, Proposition 2 for several. ``injection``:
        always Proposition 2.
    update
        What a packet says of the signal: ``bayes``, beside its prior; ``jise``, as the paper prints it, as if
        nothing were known before (the likelihoods use the prior all the same).
    feedthrough
        Whether the signal of a step shows in that step's measurements. If not, it is estimated one step
        later.
    moments
        ``linear`` for linear models; ``ekf`` and ``ukf`` linearise others (see `attack_model`).
    pruning
        Components below this share of their mixture are dropped.
    merging
        Components within this squared Mahalanobis distance are merged.
    max_components
        The most components that a mixture keeps.
    output
        What is published as the state: ``map``, the heaviest component of the likelier mixture; ``mmse``, the
        mean over everything.

    Raises
    ------
    ValueError
        When the models do not fit one another, or some direction of the signal shows in no measurement.
    """

    def __init__(
        self,
        setting: Setting,
        *,
        attack_prior: Annotated[list[AttackLaw], MinLen(1)],
        fakes: FakeBox,
        attack_birth: Probability,
        attack_survival: Probability,
        initial_attack_probability: Probability = 0.1,
        delivery: Probability = 1.0,
        substitution: Probability = 0.0,
        correction: Literal["by_arrival", "injection"] = "by_arrival",
        update: Literal["bayes", "jise"] = "bayes",
        feedthrough: bool = True,
        moments: MomentRule = "linear",
        pruning: Probability = 1e-3,
        merging: Annotated[float, Ge(0.0)] = 3.0,
        max_components: Annotated[int, Ge(1)] = 50,
        output: Literal["map", "mmse"] = "map",
    ) -> None:
        super().__init__(
            setting,
            attack_prior,
            moments=moments,
            feedthrough=feedthrough,
            switching=Switching(attack_birth, attack_survival),
            initial_attack_probability=initial_attack_probability,
        )
        self._fakes = {name: fakes.law(size) for name, size in self._sizes.items()}
        self._delivery, self._substitution = delivery, substitution
        self._by_arrival = correction == "by_arrival"
        self._unknown = update == "jise"
        self._reduction = Reduction(pruning, merging, max_components)
        self._output = output
        self._seen: dict[str, Seen] = {}
        self._detections: list[Detection] = []

    def correct(self, step: int, packets: Sequence[Packet]) -> Vector | None:
        """Predict from the step before, then correct by this step's packets; nothing is sent."""
        density = self._predicted(step) if step > 0 else self._density
        self._seen, self._detections = {}, []
        for source, members in packet_sets(step, packets, self._sizes).items():
            values = np.array([packet.values for packet in members])
            density, seen = correct_density(
                density,
                self._model.sensors[source],
                values,
                self._origin(source, values),
                n=self._model.n,
                unknown=self._unknown,
                reduction=self._reduction,
            )
            self._seen[source] = seen
            self._detections += [
                Detection(packet.source, packet.sequence, fake, fake > 0.5)
                for packet, fake in zip(members, seen.fake.tolist(), strict=True)
            ]
        self._density = settle(density, self._reduction)
        return None

    def estimate(self, step: int) -> Belief:
        """Return the state, and the verdict on each packet: the probability that it is fake.

        Diagnostics: ``attack_probability`` is r, ``components`` and ``components_attacked`` count those of
        the two mixtures. ``a0``, ``a1``, ... estimate the signal, given that there is one, with the standard
        deviations ``a0_sigma``, ...; they refer to the step ``attack_step``. ``genuine_packets`` counts the
        sensors of which the heaviest hypothesis takes a packet for genuine.
        """
        r = self._density.attack_probability()
        state, covariance = self._state(r)
        diagnostics = {
            "attack_probability": r,
            "attack_step": self._attack_step(step),
            "components": float(self._density.safe.size),
            "components_attacked": float(self._density.attacked.size),
            "genuine_packets": float(sum(seen.is_genuine for seen in self._seen.values())),
            **signal_diagnostics(*self._signal()),
        }
        return Belief(
            state,
            covariance,
            nis=sum(seen.nis for seen in self._seen.values()),
            nis_dof=sum(seen.nis_dof for seen in self._seen.values()),
            detections=self._detections,
            diagnostics=diagnostics,
        )

    def _origin(self, source: str, values: Matrix) -> Origin:
        """Return what the packets (Z, m) of a sensor may be."""
        log_densities = self._fakes[source].log_densities(values)
        if self._by_arrival and len(values) == 1:
            return substitution(self._substitution, log_densities)
        return injection(self._delivery, log_densities)

    def _state(self, r: float) -> tuple[Vector, Matrix]:
        """Return the estimate (n,) of the state and its covariance (n, n)."""
        n = self._model.n
        safe, attacked = self._density
        if self._output == "mmse":
            marginal = Mixture(attacked.log_weights, attacked.means[:, :n], attacked.covariances[:, :n, :n])
            return moments(joined(safe, marginal))
        chosen = attacked if r > 0.5 else safe
        heaviest = int(chosen.log_weights.argmax())
        return chosen.means[heaviest, :n].copy(), chosen.covariances[heaviest, :n, :n].copy()

    def _signal(self) -> tuple[Vector, Matrix]:
        """Return the estimate (q,) of the signal under attack and its covariance (q, q)."""
        n, attacked = self._model.n, self._density.attacked
        signal = self._prior
        if attacked.size:
            signal = Mixture(attacked.log_weights, attacked.means[:, n:], attacked.covariances[:, n:, n:])
        if self._output == "mmse" or not attacked.size:
            return moments(signal)
        heaviest = int(signal.log_weights.argmax())
        return signal.means[heaviest], signal.covariances[heaviest]
