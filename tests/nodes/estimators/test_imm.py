from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from filterpy.kalman import IMMEstimator, KalmanFilter

from nodes.estimators.attack_prior import AttackLaw
from nodes.estimators.imm import Imm
from tests.nodes.estimators.attacked_world import assert_chi_squared, attackable, claims, packet

PRIOR = AttackLaw(mean=[2.0], std=1.5)
RATES = {"attack_birth": 0.2, "attack_survival": 0.7}


def test_without_feedthrough_it_equals_the_filter_of_another_library():
    """There the signal is a noise of the dynamics with a mean; the first step has no attack behind it."""
    world, rng = attackable(), np.random.default_rng(1)
    plant, sensor = world.plant, world.sensors["s1"]
    imm = Imm(
        world.setting("s1"),
        attack_prior=PRIOR,
        initial_attack_probability=0.2,
        feedthrough=False,
        **RATES,
    )
    modes = []
    for attacked in (False, True):
        kf = KalmanFilter(dim_x=2, dim_z=2, dim_u=1)
        kf.x, kf.P = plant.initial_mean[:, None].copy(), plant.initial_covariance.copy()
        kf.F, kf.H, kf.R, kf.B = plant.A, sensor.C, sensor.R, plant.G * attacked
        kf.Q = plant.Q + attacked * 2.25 * plant.G @ plant.G.T
        modes.append(kf)
    first = rng.normal(0.0, 2.0, 2)
    for kf in modes:
        kf.update(first[:, None])
    oracle = IMMEstimator(modes, [1.0, 0.0], np.array([[0.8, 0.2], [0.3, 0.7]]))
    imm.correct(0, [packet(0, "s1", first)])
    for step in range(1, 15):
        values = rng.normal(0.0, 2.0, 2)
        oracle.predict(np.array([[2.0]]))
        oracle.update(values[:, None])
        imm.correct(step, [packet(step, "s1", values)])
        belief = imm.estimate(step)
        assert belief.diagnostics["attack_probability"] == pytest.approx(oracle.mu[1], abs=1e-9)
        np.testing.assert_allclose(belief.state, oracle.x[:, 0], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(belief.covariance, oracle.P, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("feedthrough", [True, False])
def test_with_a_sure_attack_errors_and_innovations_are_as_large_as_it_claims(feedthrough):
    """One mode alone is a Kalman filter; 300 independent runs, limits left once in a million campaigns."""
    world = attackable()
    if not feedthrough:
        world.sensors["s1"].H = None
    imm = partial(
        Imm,
        world.setting("s1"),
        attack_prior=PRIOR,
        attack_birth=1.0,
        attack_survival=1.0,
        initial_attack_probability=1.0,
        feedthrough=feedthrough,
    )
    runs, steps = 300, 8
    found = claims(world, imm, lambda rng, seed, step: rng.normal(2.0, 1.5, 1), runs=runs, steps=steps)
    assert found.nis_dof == 2 * runs * steps
    assert_chi_squared(found.nees, 2 * runs)
    assert_chi_squared(found.nis, found.nis_dof)


def test_while_attacks_come_and_go_it_finds_most_of_them():
    """An attack of four standard deviations of its noise; more than 9 of 10 verdicts are right."""
    world, rng = attackable(), np.random.default_rng(3)
    world = replace(world, prior=[AttackLaw(mean=[8.0], std=1.0)])
    imm = Imm(world.setting("s1", "s2"), attack_prior=world.prior[0], **RATES)
    state, before, right = world.plant.initial_state(rng), np.zeros(1), []
    for step in range(200):
        active = (step // 10) % 2 == 1
        if step:
            state = world.plant.advance(step, state, rng, attack=before)
        before = np.array([8.0 * active])
        box = [
            packet(step, name, world.sensors[name].observe(step, state, rng, attack=before))
            for name in ("s1", "s2")
        ]
        imm.correct(step, box)
        right.append((imm.estimate(step).diagnostics["attack_probability"] > 0.5) == active)
    assert np.mean(right) > 0.9
    assert imm.exchange(1, 0, []) is None
