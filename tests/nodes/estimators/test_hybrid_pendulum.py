"""The hybrid Bernoulli filter around models that are not linear."""

from typing import ClassVar

import numpy as np
import pytest

from nodes.contract import Setting
from nodes.estimators.attack_prior import AttackLaw
from nodes.estimators.hybrid_bernoulli import HybridBernoulli
from nodes.estimators.packet_sets import FakeBox
from tests.nodes.estimators.attacked_world import packet


class Pendulum:
    """A damped pendulum, sampled by Euler's rule, under a torque that an attacker may add."""

    state_groups: ClassVar[dict[str, list[int]]] = {"state": [0, 1]}
    initial_mean = np.array([1.0, 0.0])
    initial_covariance = 0.01 * np.eye(2)
    Q = np.diag([1e-6, 1e-4])
    signal_size = 1

    def transition(self, states, signals):
        angle, rate = states[:, 0], states[:, 1]
        moved = rate + 0.1 * (-9.81 * np.sin(angle) - 0.2 * rate + signals[:, 0])
        return np.stack((angle + 0.1 * rate, moved), axis=1)


class Camera:
    """A camera that sees the bob's position; the torque shows in a gauge."""

    R = np.diag([1e-3, 1e-3, 0.04])

    def measure(self, states, signals):
        angle = states[:, 0]
        return np.stack((np.sin(angle), np.cos(angle), signals[:, 0]), axis=1)

    def observe(self, step, state, rng, *, attack=None):
        values = self.measure(state[None], (np.zeros(1) if attack is None else attack)[None])[0]
        return values + np.sqrt(self.R.diagonal()) * rng.standard_normal(3)


@pytest.mark.parametrize("rule", ["ekf", "ukf"])
def test_around_a_swinging_pendulum_it_finds_the_torque_and_its_errors_are_as_large_as_it_claims(rule):
    """NEES at three steps of 60 independent runs each; the filter is not exact, so the range is by eye."""
    plant, camera, runs, nees, right = Pendulum(), Camera(), 60, [], []
    for seed in range(runs):
        rng = np.random.default_rng(seed)
        filter_ = HybridBernoulli(
            Setting("e1", plant, {"s1": camera}, {}, rng),
            attack_prior=[AttackLaw(mean=[3.0], std=1.0)],
            fakes=FakeBox(-5.0, 5.0),
            attack_birth=0.05,
            attack_survival=0.95,
            correction="injection",
            delivery=0.9,
            moments=rule,
        )
        state = plant.initial_mean + 0.1 * rng.standard_normal(2)
        for step in range(40):
            signal = np.array([3.0 * (step >= 20)])
            if step:
                before = np.array([3.0 * (step >= 21)])
                state = plant.transition(state[None], before[None])[0]
                state = state + np.sqrt(plant.Q.diagonal()) * rng.standard_normal(2)
            inbox = [camera.observe(step, state, rng, attack=signal)] * (rng.random() < 0.9)
            inbox += [*rng.uniform(-5.0, 5.0, (3, 3))]
            filter_.correct(step, [packet(step, "s1", values) for values in inbox])
            belief = filter_.estimate(step)
            right.append((belief.diagnostics["attack_probability"] > 0.5) == (step >= 20))
            if step in (10, 19, 39):
                error = belief.state - state
                nees.append(error @ np.linalg.solve(belief.covariance, error))
    assert np.mean(right) > 0.97
    assert 1.5 < np.mean(nees) < 2.6
