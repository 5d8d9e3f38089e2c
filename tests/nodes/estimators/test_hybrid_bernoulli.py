"""The hybrid Bernoulli filter against filters that are known, and against the enumeration of all stories."""

from dataclasses import replace

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from nodes.estimators.attack_prior import AttackLaw
from nodes.estimators.gaussian_mixture import moments
from nodes.gaussian import Gaussian
from nodes.plants.linear import Linear as LinearPlant
from nodes.sensors.linear import Linear as LinearSensor
from tests.nodes.estimators.attacked_world import CHANCES, attackable, packet, trial
from tests.nodes.estimators.hybrid_oracles import enumerate_hypotheses


@pytest.mark.parametrize("update", ["bayes", "jise"])
@pytest.mark.parametrize("feedthrough", [True, False])
@pytest.mark.parametrize("rule", ["linear", "ekf", "ukf"])
def test_without_attacks_and_fakes_it_equals_the_kalman_filter_of_another_library(update, feedthrough, rule):
    world, rng = attackable(), np.random.default_rng(1)
    filter_ = world.filter(
        "s1",
        attack_birth=0.0,
        initial_attack_probability=0.0,
        substitution=0.0,
        update=update,
        feedthrough=feedthrough,
        moments=rule,
    )
    kf = KalmanFilter(dim_x=2, dim_z=2)
    kf.x, kf.P = world.plant.initial_mean.copy(), world.plant.initial_covariance.copy()
    kf.F, kf.Q = world.plant.A, world.plant.Q
    kf.H, kf.R = world.sensors["s1"].C, world.sensors["s1"].R
    for step, (_, measured) in enumerate(trial(world, rng, 30)):
        arrives = rng.random() < 0.7
        filter_.correct(step, [packet(step, "s1", measured["s1"])] if arrives else [])
        if step:
            kf.predict()
        if arrives:
            kf.update(measured["s1"])
        belief = filter_.estimate(step)
        np.testing.assert_allclose(belief.state, kf.x, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(belief.covariance, kf.P, rtol=1e-9, atol=1e-9)
        assert belief.diagnostics["attack_probability"] == 0.0


def gillijns_de_moor(world, measurements, feedthrough):
    """Yield state, covariance, signal and its covariance: the filters of 2007, equation by equation."""
    A, Q, G = world.plant.A, world.plant.Q, world.plant.G
    C, R, H = (getattr(world.sensors["s1"], name) for name in "CRH")
    x, P = world.plant.initial_mean, world.plant.initial_covariance
    a, Pa, Pxa = np.zeros(G.shape[1]), np.zeros((1, 1)), np.zeros((2, 1))
    for step, y in enumerate(measurements):
        if step and feedthrough:
            x = A @ x + G @ a
            P = np.hstack((A, G)) @ np.block([[P, Pxa], [Pxa.T, Pa]]) @ np.hstack((A, G)).T + Q
        elif step:
            x, P = A @ x, A @ P @ A.T + Q
        F = H if feedthrough else C @ G
        S = C @ P @ C.T + R
        if feedthrough or step:
            Si = np.linalg.inv(S)
            Pa = np.linalg.inv(F.T @ Si @ F)
            M = Pa @ F.T @ Si
            a = M @ (y - C @ x)
        K = P @ C.T @ np.linalg.inv(S)
        if feedthrough:
            L = K @ (np.eye(2) - H @ M)
            Pxa = -K @ H @ Pa
        elif step:
            x = x + G @ a
            L, gap = K, np.eye(2) - G @ M @ C
            P_star = gap @ P @ gap.T + G @ M @ R @ M.T @ G.T
            cross = G @ M @ R
            reduced = np.eye(2) - K @ C
            # x* and y share noise through M: the covariance of the corrected estimate keeps that term.
            P = reduced @ P_star @ reduced.T + K @ R @ K.T + reduced @ cross @ K.T + K @ cross.T @ reduced.T
            x = x + K @ (y - C @ x)
            yield x, P, a, Pa
            continue
        else:
            L = K
        x = x + L @ (y - C @ x)
        P = (np.eye(2) - L @ C) @ P @ (np.eye(2) - L @ C).T + L @ R @ L.T
        yield x, P, a, Pa


@pytest.mark.parametrize("feedthrough", [True, False])
@pytest.mark.parametrize("rule", ["linear", "ekf", "ukf"])
def test_with_a_sure_attack_it_equals_the_filters_of_gillijns_and_de_moor(feedthrough, rule):
    world, rng = attackable(), np.random.default_rng(2)
    world = replace(world, prior=[AttackLaw(mean=[2.0], std=1.5)])
    filter_ = world.filter(
        "s1",
        attack_birth=1.0,
        attack_survival=1.0,
        initial_attack_probability=1.0,
        substitution=0.0,
        update="jise",
        feedthrough=feedthrough,
        moments=rule,
    )
    measured = [
        m["s1"] if feedthrough else world.sensors["s1"].observe(k, x, rng)
        for k, (x, m) in enumerate(trial(world, rng, 25, attacked=lambda step: True))
    ]
    tolerance = 1e-7 if rule == "ekf" else 1e-9
    for step, (x, P, a, Pa) in enumerate(gillijns_de_moor(world, measured, feedthrough)):
        filter_.correct(step, [packet(step, "s1", measured[step])])
        belief = filter_.estimate(step)
        np.testing.assert_allclose(belief.state, x, rtol=tolerance, atol=tolerance)
        np.testing.assert_allclose(belief.covariance, P, rtol=tolerance, atol=tolerance)
        if step or feedthrough:
            assert belief.diagnostics["attack_probability"] == 1.0
            assert belief.diagnostics["attack_step"] == (step if feedthrough else step - 1)
            assert belief.diagnostics["a0"] == pytest.approx(a[0], abs=tolerance, rel=tolerance)
            assert belief.diagnostics["a0_sigma"] == pytest.approx(np.sqrt(Pa[0, 0]), rel=tolerance)


@pytest.mark.parametrize("feedthrough", [True, False])
@pytest.mark.parametrize("correction", ["by_arrival", "injection"])
@pytest.mark.parametrize("rule", ["linear", "ukf"])
def test_its_posterior_is_that_of_the_enumeration_of_all_hypotheses(feedthrough, correction, rule):
    world, rng = attackable(), np.random.default_rng(5)
    inboxes = [
        {"s1": [rng.normal(1.0, 2.0, 2)], "s2": [rng.normal(0.0, 2.0, 1), rng.normal(0.0, 2.0, 1)]},
        {"s1": [rng.normal(1.0, 2.0, 2), rng.normal(3.0, 2.0, 2)]},
        {"s1": [rng.normal(1.0, 2.0, 2)], "s2": [rng.normal(0.0, 2.0, 1)]},
    ]
    chosen = {**CHANCES, "correction": correction}
    filter_ = world.filter("s1", "s2", feedthrough=feedthrough, output="mmse", moments=rule, **chosen)
    for steps in range(1, 4):
        filter_.correct(
            steps - 1,
            [packet(steps - 1, name, v) for name, values in inboxes[steps - 1].items() for v in values],
        )
        exact = enumerate_hypotheses(world, inboxes[:steps], chosen, feedthrough)
        belief = filter_.estimate(steps - 1)
        tolerance = {"rtol": 1e-10, "atol": 1e-10} if rule == "linear" else {"rtol": 1e-8, "atol": 1e-8}
        np.testing.assert_allclose(belief.diagnostics["attack_probability"], exact.r, **tolerance)
        modes = [(1.0 - exact.r, *exact.safe)]
        if exact.r > 0.0:
            modes.append((exact.r, *exact.attacked))
            mean, covariance = moments(filter_._density.attacked)
            np.testing.assert_allclose(mean, exact.attacked[0], **tolerance)
            np.testing.assert_allclose(covariance, exact.attacked[1], **tolerance)
        mean = sum(w * m[:2] for w, m, _ in modes)
        np.testing.assert_allclose(belief.state, mean, **tolerance)
        covariance = sum(w * (P[:2, :2] + np.outer(m[:2] - mean, m[:2] - mean)) for w, m, P in modes)
        np.testing.assert_allclose(belief.covariance, covariance, **tolerance)


def stacked_jise(world, names, measured):
    """Return state, covariance, signal and its covariance after one step, of the stacked measurement."""
    C, H = (np.vstack([getattr(world.sensors[name], matrix) for name in names]) for matrix in "CH")
    R = np.zeros((len(C), len(C)))
    at = 0
    for name in names:
        size = len(world.sensors[name].R)
        R[at : at + size, at : at + size] = world.sensors[name].R
        at += size
    x, P = world.plant.initial_mean, world.plant.initial_covariance
    y = np.concatenate([measured[name] for name in names])
    Si = np.linalg.inv(C @ P @ C.T + R)
    Pa = np.linalg.inv(H.T @ Si @ H)
    M = Pa @ H.T @ Si
    a = M @ (y - C @ x)
    L = P @ C.T @ Si @ (np.eye(len(C)) - H @ M)
    gap = np.eye(2) - L @ C
    return x + L @ (y - C @ x), gap @ P @ gap.T + L @ R @ L.T, a, Pa


@pytest.mark.parametrize("order", [("s1", "s2", "s3"), ("s3", "s2", "s1"), ("s2", "s1", "s3"), ("s2", "s3")])
def test_sensors_taken_one_by_one_fix_the_signal_as_their_stacked_measurement_does(order):
    """No sensor alone shows both directions of this signal."""
    world, rng = attackable(2), np.random.default_rng(3)
    world = replace(world, prior=world.prior[:1])
    filter_ = world.filter(
        *order, initial_attack_probability=1.0, substitution=0.0, update="jise", correction="by_arrival"
    )
    _, measured = next(trial(world, rng, 1, attacked=lambda step: True, names=order))
    filter_.correct(0, [packet(0, name, measured[name]) for name in reversed(order)])
    x, P, a, Pa = stacked_jise(world, order, measured)
    belief = filter_.estimate(0)
    np.testing.assert_allclose(belief.state, x, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(belief.covariance, P, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose([belief.diagnostics[f"a{i}"] for i in (0, 1)], a, rtol=1e-9, atol=1e-9)
    sigma = [belief.diagnostics[f"a{i}_sigma"] for i in (0, 1)]
    np.testing.assert_allclose(sigma, np.sqrt(Pa.diagonal()), rtol=1e-9)


@pytest.mark.parametrize("update", ["bayes", "jise"])
def test_a_direction_of_the_signal_that_no_arrived_packet_shows_keeps_its_prior(update):
    world = replace(attackable(2), prior=[AttackLaw(mean=[2.0, -7.0], std=[1.5, 0.4])])
    filter_ = world.filter("s1", "s2", initial_attack_probability=1.0, substitution=0.0, update=update)
    filter_.correct(0, [packet(0, "s1", [5.0, 1.0])])  # s1 does not see the second component
    found = filter_.estimate(0).diagnostics
    assert found["a1"] == pytest.approx(-7.0, abs=1e-12)
    assert found["a1_sigma"] == pytest.approx(0.4, abs=1e-12)
    assert found["a0"] != pytest.approx(2.0, abs=0.1)
    assert found["a0_sigma"] != pytest.approx(1.5, abs=0.1)


@pytest.mark.parametrize("prior_std", [1e3, 1e5])
def test_bayes_tends_to_the_unknown_signal_as_its_prior_loses_all_information(prior_std):
    world, rng = attackable(2), np.random.default_rng(4)
    world = replace(world, prior=[AttackLaw(mean=[2.0, 2.0], std=prior_std)])
    found = []
    _, measured = next(trial(world, rng, 1, attacked=lambda step: True, names=world.sensors))
    for update in ("bayes", "jise"):
        filter_ = world.filter(initial_attack_probability=1.0, substitution=0.0, update=update)
        filter_.correct(0, [packet(0, name, values) for name, values in measured.items()])
        found.append(filter_.estimate(0))
    np.testing.assert_allclose(found[0].state, found[1].state, atol=1e-4)
    np.testing.assert_allclose(found[0].covariance, found[1].covariance, atol=1e-4)
    assert np.linalg.eigvalsh(found[0].covariance)[0] > 0.0


def test_an_input_moves_both_mixtures():
    plant = LinearPlant(
        1.0,
        A=[[1.0]],
        process_noise=Gaussian(std=0.1),
        initial=Gaussian(std=1.0),
        G=[[1.0]],
        B=[[2.0]],
    )
    world = replace(
        attackable(),
        plant=plant,
        sensors={"s1": LinearSensor(plant, C=[[1.0]], noise=Gaussian(std=1.0), H=[[1.0]])},
        prior=[AttackLaw(mean=[0.0], std=1.0)],
    )
    for feedthrough in (True, False):
        filter_ = world.filter(output="mmse", feedthrough=feedthrough)
        filter_.correct(0, [])
        filter_.control(0, [packet(0, "c1", [1.5])])
        filter_.correct(1, [])
        assert filter_.estimate(1).state[0] == pytest.approx(3.0)
