"""The hybrid Bernoulli recursion on a scalar plant against the integrals of Forti et al. 2019 on a grid.

The grid knows nothing of Gaussian mixtures: densities are numbers at points, and prediction and correction
are sums over them (Theorems 1 to 5). For functions so smooth the sums converge faster than any power of the
spacing; what is left is rounding.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from nodes.contract import Setting
from nodes.estimators.attack_prior import AttackLaw
from nodes.estimators.hybrid_bernoulli import HybridBernoulli
from nodes.estimators.packet_sets import FakeBox
from nodes.gaussian import Gaussian
from nodes.plants.linear import Linear as LinearPlant
from nodes.sensors.linear import Linear as LinearSensor
from tests.nodes.estimators.attacked_world import packet

A, G, C, H, Q_STD, R_STD = 0.8, 1.3, 1.1, 0.9, 0.4, 0.5
BIRTH, SURVIVAL, START, DELIVERY, SUBSTITUTION = 0.25, 0.7, 0.3, 0.85, 0.2
INITIAL = (0.5, 1.0)
PRIOR = ((0.7, 1.5, 0.8), (0.3, -1.0, 0.6))
"""Weight, mean and standard deviation of the components of the signal's law."""
BOX = (-4.0, 6.0)
SPACING = 0.2
X = np.arange(-80, 91) * SPACING
S = np.arange(-40, 56) * SPACING
INBOXES = ([1.4], [2.9, -0.3, 5.0], [], [0.2], [3.1, 3.3])
"""Packets by step: one that is likely true, several, none, one far off, two that resemble each other."""


def normal(at, mean, std):
    return np.exp(-0.5 * ((at - mean) / std) ** 2) / (np.sqrt(2.0 * np.pi) * std)


@dataclass
class Grid:
    """``safe`` (x) is ``(1 - r) p0(x)``, ``attacked`` (a, x) is ``r p1(a, x)``, at the points of the grid."""

    safe: np.ndarray
    attacked: np.ndarray
    feedthrough: bool

    @classmethod
    def at_start(cls, feedthrough):
        law, r = normal(X, *INITIAL), START if feedthrough else 0.0
        return cls((1.0 - r) * law, r * np.outer(signal_law(), law), feedthrough)

    def predict(self, step):
        """Theorem 3, or 5 without feedthrough: the signal of a step enters on the way out of it."""
        birth = START if step == 1 and not self.feedthrough else BIRTH
        if self.feedthrough:
            from_safe = SPACING * normal(X[:, None], A * X, Q_STD) @ self.safe
            from_attacked = np.zeros(len(X))
            for a, slice_ in zip(S, self.attacked, strict=True):
                from_attacked += SPACING**2 * normal(X[:, None], A * X + G * a, Q_STD) @ slice_
            under = birth * from_safe + SURVIVAL * from_attacked
            self.attacked = np.outer(signal_law(), under)
        else:
            marginal = SPACING * self.attacked.sum(axis=0)
            before = birth * self.safe + SURVIVAL * marginal
            free = SPACING * normal(X[:, None], A * X, Q_STD)
            from_safe, from_attacked = free @ self.safe, free @ marginal
            moved = [SPACING * normal(X[:, None], A * X + G * a, Q_STD) @ before for a in S]
            self.attacked = signal_law()[:, None] * np.array(moved)
        self.safe = (1.0 - birth) * from_safe + (1.0 - SURVIVAL) * from_attacked

    def correct(self, values, lone_may_be_replaced):
        """Theorems 1 and 2 (4 without feedthrough)."""
        if not values:
            return
        kappa = 1.0 / (BOX[1] - BOX[0])
        shown = H * S[:, None] if self.feedthrough else 0.0
        for name, mean in (("safe", C * X), ("attacked", C * X + shown)):
            likelihoods = [normal(y, mean, R_STD) for y in values]
            if lone_may_be_replaced and len(values) == 1:
                factor = SUBSTITUTION * kappa + (1.0 - SUBSTITUTION) * likelihoods[0]
            else:
                factor = 1.0 - DELIVERY + DELIVERY / len(values) * sum(likelihoods) / kappa
            setattr(self, name, getattr(self, name) * factor)
        total = SPACING * self.safe.sum() + SPACING**2 * self.attacked.sum()
        self.safe, self.attacked = self.safe / total, self.attacked / total

    def figures(self):
        """Return r, mean and variance of the state, and mean and variance of the signal under attack."""
        r = SPACING**2 * self.attacked.sum()
        whole = SPACING * self.safe + SPACING**2 * self.attacked.sum(axis=0)
        found = [r, *mean_and_variance(X, whole)]
        return found + (mean_and_variance(S, self.attacked.sum(axis=1)) if r > 0.0 else [])


def signal_law():
    return sum(weight * normal(S, mean, std) for weight, mean, std in PRIOR)


def mean_and_variance(at, density):
    share = density / density.sum()
    mean = share @ at
    return [mean, share @ (at - mean) ** 2]


def hybrid(correction, feedthrough):
    plant = LinearPlant(
        1.0,
        A=[[A]],
        G=[[G]],
        process_noise=Gaussian(std=Q_STD),
        initial=Gaussian(mean=[INITIAL[0]], std=INITIAL[1]),
    )
    sensor = LinearSensor(plant, C=[[C]], H=[[H]] if feedthrough else None, noise=Gaussian(std=R_STD))
    return HybridBernoulli(
        Setting("e1", plant, {"s1": sensor}, {}, np.random.default_rng(0)),
        attack_prior=[AttackLaw(weight=weight, mean=[mean], std=std) for weight, mean, std in PRIOR],
        fakes=FakeBox(*BOX),
        attack_birth=BIRTH,
        attack_survival=SURVIVAL,
        initial_attack_probability=START,
        delivery=DELIVERY,
        substitution=SUBSTITUTION,
        correction=correction,
        feedthrough=feedthrough,
        pruning=0.0,
        merging=0.0,
        max_components=100_000,
        output="mmse",
    )


@pytest.mark.parametrize("feedthrough", [True, False])
@pytest.mark.parametrize("correction", ["by_arrival", "injection"])
def test_on_a_scalar_plant_the_recursion_is_that_of_the_integrals(correction, feedthrough):
    filter_, grid = hybrid(correction, feedthrough), Grid.at_start(feedthrough)
    for step, values in enumerate(INBOXES):
        if step:
            grid.predict(step)
        grid.correct(values, lone_may_be_replaced=correction == "by_arrival")
        filter_.correct(step, [packet(step, "s1", [value]) for value in values])
        belief = filter_.estimate(step)
        said = belief.diagnostics
        found = [said["attack_probability"], belief.state[0], belief.covariance[0, 0]]
        found += [said["a0"], said["a0_sigma"] ** 2]
        expected = grid.figures()
        np.testing.assert_allclose(found[: len(expected)], expected, rtol=1e-10, atol=1e-10)
