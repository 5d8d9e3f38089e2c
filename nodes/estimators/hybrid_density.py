"""The recursion of the Gaussian-mixture hybrid Bernoulli filter (Forti et al. 2019, sections III to V).

The joint density of "is there an attack", its signal and the state is a pair of mixtures: one of the state,
``(1 - r) p0(x)``, and one of state and signal, ``r p1(a, x)``. Here the weights of both carry the factors ``1
- r`` and ``r``, so that a correction multiplies by likelihoods and normalises once: ``r`` follows, and can
leave [0, 1] by nothing but rounding. The state stands before the signal.

**Without feedthrough** the signal that entered on the way into a step is found in that step. The mixture
under attack is then kept over ``x^-``, the state before the signal entered, and ``a``; with ``x = x^- + G a``
the measurement ``C x`` is a measurement with feedthrough ``H = C G``, so that one correction serves both
forms.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bus.packets import Vector
from nodes.contract import Matrix
from nodes.estimators.attack_model import AttackModel, Map
from nodes.estimators.gaussian_mixture import Mixture, joined, log_sum, merge, survivors, symmetric
from nodes.estimators.joint_input_state import Correction, Linearised, correct


class Density(NamedTuple):
    """The pair of mixtures: without attack over (n,), and under attack over (n + q,)."""

    safe: Mixture
    attacked: Mixture

    def normalised(self) -> Density:
        """Return the same with a total weight of one."""
        total = np.logaddexp(self.safe.log_total(), self.attacked.log_total())
        return Density(*(part.weighing(part.log_weights - total) for part in self))

    def attack_probability(self) -> float:
        """Return ``r``, of a normalised density."""
        return min(1.0, math.exp(self.attacked.log_total()))


@dataclass(frozen=True)
class Reduction:
    """How mixtures are kept small: shares below ``pruning`` go, at most ``most`` stay, close ones merge."""

    pruning: float
    merging: float
    most: int


class Switching(NamedTuple):
    """How attacks come and go: the probabilities ``p_b`` of birth and ``p_s`` of survival, per step."""

    birth: float
    survival: float


class Origin(NamedTuple):
    """The logarithms of what the packets of one sensor in one step say of their origin.

    ``none`` belongs to the hypothesis that none is genuine, ``genuine`` (Z,) to that this one is, of which
    its likelihood is a factor besides.
    """

    none: float
    genuine: Vector


class Seen(NamedTuple):
    """What a correction by one sensor's packets found, before anything was pruned.

    ``fake`` (Z,) is the probability of each packet to be fake. ``nis`` with ``nis_dof`` belongs to the
    heaviest hypothesis. ``is_genuine`` tells whether that takes any packet for genuine.
    """

    fake: Vector
    nis: float
    nis_dof: int

    @property
    def is_genuine(self) -> bool:
        """Whether the heaviest hypothesis takes a packet for genuine."""
        return self.nis_dof > 0


def substitution(probability: float, log_densities: Vector) -> Origin:
    """Return the origin of a lone packet that may have replaced the genuine one (Proposition 1)."""
    return Origin(_log(probability) + float(log_densities[0]), np.array([_log(1.0 - probability)]))


def injection(delivery: float, log_densities: Vector) -> Origin:
    """Return the origin of packets of which one at most is genuine (Proposition 2).

    ``log_densities`` (Z,) are those of fakes. One that cannot be a fake is genuine; two such are impossible.
    """
    level = _log(delivery) - math.log(len(log_densities))
    surely_genuine = log_densities == -math.inf
    count = int(np.count_nonzero(surely_genuine))
    if not count:
        return Origin(_log(1.0 - delivery), level - log_densities)
    return Origin(-math.inf, np.where(surely_genuine & (count == 1), level, -math.inf))


def correct_density(
    density: Density,
    sensor: Map,
    packets: Matrix,
    origin: Origin,
    *,
    n: int,
    unknown: bool,
    reduction: Reduction,
    noise: Matrix | None = None,
) -> tuple[Density, Seen]:
    """Correct by the packets (Z, m) of one sensor, and prune (Propositions 1 and 2).

    ``noise`` (m, m) is the covariance of each packet's; None for the sensor's.
    """
    safe, attacked = density
    R = sensor.noise if noise is None else noise
    found = (
        correct(safe, sensor.plain(safe.means, safe.covariances), R, packets, unknown=False),
        correct(attacked, sensor_under_attack(attacked, sensor, n), R, packets, unknown),
    )
    weights = [_hypotheses(part, one, origin) for part, one in zip((safe, attacked), found, strict=True)]
    if max(log_sum(of_mode) for of_mode in weights) == -math.inf:
        return density, Seen(np.ones(len(packets)), 0.0, 0)
    seen = _what_was_seen(weights, found, R.shape[0])
    kept = (
        _chosen(part, one, of_mode, reduction)
        for part, one, of_mode in zip((safe, attacked), found, weights, strict=True)
    )
    return Density(*kept).normalised(), seen


def settle(density: Density, reduction: Reduction) -> Density:
    """Return the density after a step's corrections: the signal has entered, close components are merged."""
    safe, attacked = density
    entry = attacked.entry
    means, covariances = attacked.means, attacked.covariances
    if entry is not None:
        n, q = entry.shape[1:]
        enter = np.zeros((attacked.size, n + q, n + q))
        enter[:] = np.eye(n + q)
        enter[:, :n, n:] = entry
        means = np.matmul(enter, means[:, :, None])[:, :, 0]
        covariances = symmetric(np.matmul(np.matmul(enter, covariances), enter.swapaxes(1, 2)))
    attacked = Mixture(attacked.log_weights, means, covariances)
    return Density(merge(safe, reduction.merging), merge(attacked, reduction.merging)).normalised()


def start(mean: Vector, covariance: Matrix, prior: Mixture, probability: float) -> Density:
    """Return the density before the first correction, with feedthrough: ``r`` and one law of the state."""
    law = Mixture(np.zeros(1), mean[None], covariance[None])
    safe = law.weighing(law.log_weights + _log(1.0 - probability))
    attacked = law.weighing(law.log_weights + _log(probability))
    return Density(_possible(safe), _with_signal(_possible(attacked), prior))


def predict(
    density: Density, model: AttackModel, prior: Mixture, switching: Switching, effect: Vector | None
) -> Density:
    """Predict one step, where the signal of the step before enters the dynamics (Proposition 3)."""
    from_safe = _moved(density.safe, model.dynamics, effect, joint=False)
    from_attacked = _moved(density.attacked, model.dynamics, effect, joint=True)
    safe, attacked = _switched(from_safe, from_attacked, switching)
    return Density(safe, _with_signal(attacked, prior)).normalised()


def predict_without_feedthrough(
    density: Density, model: AttackModel, prior: Mixture, switching: Switching, effect: Vector | None
) -> Density:
    """Predict one step, of which the signal is to be found at its end (Theorem 5)."""
    n, attacked = model.n, density.attacked
    marginal = Mixture(attacked.log_weights, attacked.means[:, :n], attacked.covariances[:, :n, :n])
    safe, under = _switched(density.safe, marginal, switching)
    under = _with_signal(under, prior)
    linear = model.dynamics.joint(under.means, under.covariances)
    entry = np.broadcast_to(linear.slope[:, :, n:], (under.size, n, model.q))
    # The signal enters in `settle`, around zero: its prior mean has no part in the state's mean until then.
    before = linear.value - np.matmul(entry, under.means[:, n:, None])[:, :, 0]
    means = np.concatenate((before if effect is None else before + effect, under.means[:, n:]), axis=1)
    slope = linear.slope[:, :, :n]
    covariances = under.covariances.copy()
    covariances[:, :n, :n] = _spread(under.covariances[:, :n, :n], slope, linear, model.dynamics.noise)
    attacked = Mixture(under.log_weights, means, covariances, under.free, entry)
    return Density(_moved(safe, model.dynamics, effect, joint=False), attacked).normalised()


def _log(probability: float) -> float:
    return math.log(probability) if probability > 0.0 else -math.inf


def _possible(mixture: Mixture) -> Mixture:
    """Return the components whose weight is not zero."""
    possible = mixture.log_weights > -math.inf
    if possible.all():
        return mixture
    return Mixture(mixture.log_weights[possible], mixture.means[possible], mixture.covariances[possible])


def _switched(from_safe: Mixture, from_attacked: Mixture, switching: Switching) -> tuple[Mixture, Mixture]:
    """Return the laws of the state in the next step, without attack and under one."""
    both = joined(from_safe, from_attacked)
    before = np.repeat([0, 1], [from_safe.size, from_attacked.size])
    ending = np.array([_log(1.0 - switching.birth), _log(1.0 - switching.survival)])
    lasting = np.array([_log(switching.birth), _log(switching.survival)])
    return (
        _possible(both.weighing(both.log_weights + ending[before])),
        _possible(both.weighing(both.log_weights + lasting[before])),
    )


def _moved(mixture: Mixture, dynamics: Map, effect: Vector | None, joint: bool) -> Mixture:
    """Return the laws (n,) of the state one step later."""
    move = dynamics.joint if joint else dynamics.plain
    linear = move(mixture.means, mixture.covariances)
    covariances = _spread(mixture.covariances, linear.slope, linear, dynamics.noise)
    value = linear.value if effect is None else linear.value + effect
    return Mixture(mixture.log_weights, value, covariances)


def _spread(covariances: np.ndarray, slope: np.ndarray, linear: Linearised, noise: Matrix) -> np.ndarray:
    """Return ``E P E' + Q`` (J, n, n), and what the slope does not explain."""
    moved = symmetric(np.matmul(np.matmul(slope, covariances), slope.swapaxes(1, 2)))
    return moved + noise if linear.spread is None else moved + noise + linear.spread


def _with_signal(states: Mixture, prior: Mixture) -> Mixture:
    """Return each law of the state beside each of the signal, which do not depend on one another."""
    n, q = states.means.shape[1], prior.means.shape[1]
    size = states.size * prior.size
    covariances = np.zeros((size, n + q, n + q))
    pairs = covariances.reshape(states.size, prior.size, n + q, n + q)
    pairs[:, :, :n, :n] = states.covariances[:, None]
    pairs[:, :, n:, n:] = prior.covariances
    means = np.empty((size, n + q))
    of_pairs = means.reshape(states.size, prior.size, n + q)
    of_pairs[:, :, :n] = states.means[:, None]
    of_pairs[:, :, n:] = prior.means
    log_weights = (states.log_weights[:, None] + prior.log_weights).ravel()
    return Mixture(log_weights, means, covariances, np.broadcast_to(np.eye(q), (size, q, q)))


def sensor_under_attack(attacked: Mixture, sensor: Map, n: int) -> Linearised:
    """Return what a sensor measures of the components under attack, as a map of ``(x^-, a)``."""
    entry = attacked.entry
    if entry is None:
        return sensor.joint(attacked.means, attacked.covariances)
    enter = np.concatenate((np.broadcast_to(np.eye(n), (attacked.size, n, n)), entry), axis=2)
    means = np.matmul(enter, attacked.means[:, :, None])[:, :, 0]
    covariances = np.matmul(np.matmul(enter, attacked.covariances), enter.swapaxes(1, 2))
    linear = sensor.plain(means, symmetric(covariances))
    return Linearised(linear.value, np.matmul(linear.slope, enter), linear.spread)


def _hypotheses(mixture: Mixture, found: Correction, origin: Origin) -> Matrix:
    """Return the logarithms of the weights (J, 1 + Z): of no genuine packet, and of each."""
    priors = mixture.log_weights[:, None]
    weights: Matrix = np.concatenate(
        (priors + origin.none, priors + (origin.genuine + found.log_likelihoods)), axis=1
    )
    return weights


def _what_was_seen(weights: list[Matrix], found: tuple[Correction, ...], outputs: int) -> Seen:
    """Return the verdict on the packets, over both mixtures."""
    largest = max(float(of_mode.max()) for of_mode in weights if of_mode.size)
    shares = sum(np.exp(of_mode - largest).sum(axis=0) for of_mode in weights)
    fake: Vector = np.clip(1.0 - shares[1:] / shares.sum(), 0.0, 1.0)
    mode = int(np.argmax([of_mode.max(initial=-math.inf) for of_mode in weights]))
    component, packet = divmod(int(weights[mode].argmax()), weights[mode].shape[1])
    if packet == 0:
        return Seen(fake, 0.0, 0)
    return Seen(fake, float(found[mode].nis[component, packet - 1]), outputs)


def _chosen(mixture: Mixture, found: Correction, weights: Matrix, reduction: Reduction) -> Mixture:
    """Return the components worth keeping: only for these are mean and covariance put together.

    They share the weight of the whole mixture.
    """
    kept = survivors(weights, reduction.pruning, reduction.most)
    component, packet = np.divmod(kept, weights.shape[1])
    corrected = packet > 0
    log_weights = weights.ravel()[kept]
    log_weights += log_sum(weights) - log_sum(log_weights)
    innovation = found.innovations[component, packet - 1] * corrected[:, None]
    gain = found.gain[component]
    means = mixture.means[component] + np.matmul(gain, innovation[:, :, None])[:, :, 0]
    choose = corrected[:, None, None]
    covariances = np.where(choose, found.covariances[component], mixture.covariances[component])
    free, entry = mixture.free, mixture.entry
    if free is not None:
        free = None if found.free is None else np.where(choose, found.free[component], free[component])
    return Mixture(log_weights, means, covariances, free, None if entry is None else entry[component])
