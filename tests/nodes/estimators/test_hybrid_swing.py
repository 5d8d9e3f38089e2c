"""The hybrid Bernoulli filter with moments of an EKF or UKF, on a power network in large swings."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from nodes.contract import Setting
from nodes.estimators.attack_prior import AttackLaw
from nodes.estimators.hybrid_bernoulli import HybridBernoulli
from nodes.estimators.packet_sets import FakeBox
from nodes.gaussian import Gaussian
from nodes.plants.ieee14 import Ieee14
from nodes.plants.sine_swing import SineIeee14
from nodes.sensors.linear import Linear
from tests.nodes.estimators.attacked_world import packet

LAWS = {"process_noise": Gaussian(std=0.01), "initial": Gaussian(std=[1.0] * 5 + [0.1] * 5)}
"""Angles that differ by a radian and more: there a sine is not its argument."""
LOAD = np.array([0.2, 0.1])
C = np.vstack((np.eye(10), np.zeros((2, 10))))
H = np.vstack((np.zeros((10, 2)), np.eye(2)))
STEPS, ONSET = 100, 50


def hybrid(plant, rule):
    sensor = Linear(plant, C=C.tolist(), H=H.tolist(), noise=Gaussian(std=0.1))
    return HybridBernoulli(
        Setting("e1", plant, {"s1": sensor}, {}, np.random.default_rng(0)),
        attack_prior=[AttackLaw(mean=LOAD.tolist(), std=0.1)],
        fakes=FakeBox(-10.0, 5.0),
        attack_birth=0.05,
        attack_survival=0.95,
        initial_attack_probability=0.05,
        delivery=0.95,
        correction="injection",
        pruning=0.01,
        merging=3.0,
        moments=rule,
    )


def trial(plant, seed, steps=STEPS, onset=ONSET):
    """Yield the state and the packets of each step: the genuine one, if not lost, among up to nine fakes."""
    rng = np.random.default_rng(seed)
    state = plant.initial_state(rng)
    for step in range(steps):
        if step:
            state = plant.advance(step, state, rng, attack=LOAD * (step > onset))
        measured = C @ state + H @ (LOAD * (step >= onset)) + 0.1 * rng.standard_normal(12)
        fakes = rng.uniform(-10.0, 5.0, (rng.integers(0, 10), 12))
        inbox = [measured] * (rng.random() < 0.95) + [*fakes]
        yield state, [packet(step, "s1", values) for values in inbox]


def play(filter_, plant, seed):
    """Return the attack probability (K,) and the NEES (K,) of a run."""
    r, nees = [], []
    for step, (state, inbox) in enumerate(trial(plant, seed)):
        filter_.correct(step, inbox)
        belief = filter_.estimate(step)
        error = belief.state - state
        r.append(belief.diagnostics["attack_probability"])
        nees.append(error @ np.linalg.solve(belief.covariance, error))
    return np.array(r), np.array(nees)


@pytest.mark.parametrize("rule", ["ekf", "ukf"])
def test_in_large_swings_it_finds_altered_loads_and_errs_as_it_says(rule):
    """NEES at three steps of 12 independent runs; a consistent filter fails once in a thousand such tests."""
    plant = SineIeee14(0.01, **LAWS)
    runs = [play(hybrid(plant, rule), plant, seed) for seed in range(12)]
    r = np.array([one for one, _ in runs])
    assert r[:, :ONSET].mean() < 0.1
    assert r[:, ONSET + 2 :].mean() > 0.9
    nees = np.array([one[[20, 49, 99]] for _, one in runs])
    print(f"\n{rule}: NEES by degrees of freedom {nees.mean() / 10:.3f}")
    low, high = chi2.ppf([0.0005, 0.9995], 10 * nees.size)
    assert low < nees.sum() < high


def test_in_large_swings_the_small_signal_model_is_deluded():
    """What the moments are for: the linear filter's errors are many times what it says."""
    plant = SineIeee14(0.01, **LAWS)
    nees = [play(hybrid(Ieee14(0.01, **LAWS), "linear"), plant, seed)[1] for seed in range(4)]
    ratio = np.mean([one[[20, 49, 99]] for one in nees]) / 10
    print(f"\nsmall-signal model: NEES by degrees of freedom {ratio:.0f}")
    assert ratio > 10.0


@pytest.mark.parametrize(("rule", "tolerance"), [("ekf", 1e-9), ("ukf", 1e-9)])
def test_on_the_small_signal_network_all_moments_give_the_same_posterior(rule, tolerance):
    plant = Ieee14(0.01, **LAWS)
    exact, other = hybrid(plant, "linear"), hybrid(plant, rule)
    for step, (_, inbox) in enumerate(trial(plant, 7, steps=60, onset=30)):
        for filter_ in (exact, other):
            filter_.correct(step, inbox)
        expected, found = exact.estimate(step), other.estimate(step)
        np.testing.assert_allclose(found.state, expected.state, rtol=tolerance, atol=tolerance)
        np.testing.assert_allclose(found.covariance, expected.covariance, rtol=tolerance, atol=tolerance)
        for name, value in expected.diagnostics.items():
            assert found.diagnostics[name] == pytest.approx(value, rel=tolerance, abs=tolerance)
