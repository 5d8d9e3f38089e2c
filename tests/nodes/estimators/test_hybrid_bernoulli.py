from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from hypothesis import given, settings
from hypothesis import strategies as st

from nodes.contract import Setting
from nodes.estimators.attack_prior import AttackLaw
from nodes.estimators.gaussian_mixture import moments
from nodes.estimators.hybrid_bernoulli import HybridBernoulli
from nodes.estimators.packet_sets import FakeBox
from nodes.gaussian import Gaussian
from nodes.plants.linear import Linear as LinearPlant
from nodes.sensors.linear import Linear as LinearSensor
from tests.nodes.estimators.hybrid_oracles import attackable, enumerate_hypotheses, packet

ESTIMATOR = {
    "attack_birth": 0.3,
    "attack_survival": 0.6,
    "delivery": 0.8,
    "substitution": 0.25,
    "initial_attack_probability": 0.4,
}


def trial(world, rng, steps, *, attacked=lambda step: False, names=None):
    """Yield the state and the genuine measurements by sensor of each step."""
    q = world.plant.G.shape[1]
    state = world.plant.initial_state(rng)
    for step in range(steps):
        signal = np.full(q, 3.0) * attacked(step)
        if step:
            state = world.plant.advance(step, state, rng, attack=np.full(q, 3.0) * attacked(step - 1))
        yield (
            state,
            {name: world.sensors[name].observe(step, state, rng, attack=signal) for name in names or ["s1"]},
        )


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
    chosen = {**ESTIMATOR, "correction": correction}
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


values = st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=2)


@settings(max_examples=40, deadline=None)
@given(
    inboxes=st.lists(st.lists(values, max_size=4), min_size=1, max_size=8),
    update=st.sampled_from(["bayes", "jise"]),
    feedthrough=st.booleans(),
    delivery=st.sampled_from([0.0, 0.7, 1.0]),
    substitution=st.sampled_from([0.0, 0.3, 1.0]),
)
def test_whatever_arrives_probabilities_stay_probabilities_and_covariances_definite(
    inboxes, update, feedthrough, delivery, substitution
):
    filter_ = attackable().filter(
        "s1",
        update=update,
        feedthrough=feedthrough,
        delivery=delivery,
        substitution=substitution,
        pruning=1e-3,
        merging=3.0,
        max_components=20,
    )
    for step, inbox in enumerate(inboxes):
        filter_.correct(step, [packet(step, "s1", v) for v in inbox])
        belief = filter_.estimate(step)
        density = filter_._density
        total = np.exp(density.safe.log_weights).sum() + np.exp(density.attacked.log_weights).sum()
        assert total == pytest.approx(1.0, abs=1e-12)
        assert 0.0 <= belief.diagnostics["attack_probability"] <= 1.0
        assert all(0.0 <= verdict.statistic <= 1.0 for verdict in belief.detections)
        assert np.array_equal(belief.covariance, belief.covariance.T)
        assert np.linalg.eigvalsh(belief.covariance)[0] > 0.0
        assert max(density.safe.size, density.attacked.size) <= 20


def test_twenty_gross_outliers_weigh_as_if_the_genuine_packet_were_delivered_less_often():
    """``1 - p_d + p_d l / (21 kappa)`` is ``1 - p + p l / kappa`` but for a factor, with p = 0.16."""
    world, rng = attackable(), np.random.default_rng(6)
    common = {"pruning": 1e-3, "merging": 3.0, "correction": "injection"}
    among = world.filter("s1", delivery=0.8, **common)
    alone = world.filter("s1", delivery=0.16, **common)
    sizes = [10.0**size for size in (3, 6, 9, 150, 300)]
    outliers = [[x, y * sign] for x in sizes[:2] for y in sizes for sign in (1.0, -1.0)]
    for step, (_, measured) in enumerate(trial(world, rng, 20)):
        genuine = packet(step, "s1", measured["s1"])
        among.correct(step, [genuine, *(packet(step, "s1", values) for values in outliers)])
        alone.correct(step, [genuine])
        found, expected = among.estimate(step), alone.estimate(step)
        np.testing.assert_allclose(found.state, expected.state, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(found.covariance, expected.covariance, rtol=1e-9, atol=1e-9)
        assert found.diagnostics == pytest.approx(expected.diagnostics, abs=1e-9)
        assert [one.statistic for one in found.detections[1:]] == 20 * [1.0]


def test_a_measurement_too_unlikely_for_a_double_is_weighed_as_the_enumeration_weighs_it():
    """It is off where the signal has no say: the likelihoods of both modes are about e^-20000."""
    world = attackable()
    plant, sensor = world.plant, world.sensors["s1"]
    S = sensor.C @ plant.initial_covariance @ sensor.C.T + sensor.R
    away = S @ np.array([-sensor.H[1, 0], sensor.H[0, 0]])
    away *= 200.0 / np.sqrt(away @ np.linalg.solve(S, away))
    value = sensor.C @ plant.initial_mean + away
    chosen = {**ESTIMATOR, "correction": "by_arrival", "substitution": 0.0}
    filter_ = world.filter("s1", output="mmse", **chosen)
    filter_.correct(0, [packet(0, "s1", value)])
    exact, belief = enumerate_hypotheses(world, [{"s1": [value]}], chosen, True), filter_.estimate(0)
    assert 0.01 < exact.r < 0.99
    assert belief.nis == pytest.approx(4e4, rel=1e-3)
    assert belief.diagnostics["attack_probability"] == pytest.approx(exact.r, abs=1e-9)
    mean = (1.0 - exact.r) * exact.safe[0] + exact.r * exact.attacked[0][:2]
    np.testing.assert_allclose(belief.state, mean, rtol=1e-9)


@pytest.mark.slow
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("update", ["bayes", "jise"])
@pytest.mark.parametrize("feedthrough", [True, False])
def test_over_ten_thousand_steps_no_covariance_loses_symmetry_or_definiteness(update, feedthrough):
    """The prior of the signal is so wide that the unstable form ``P - K S K'`` would lose all digits."""
    world, rng = attackable(), np.random.default_rng(9)
    world = replace(world, prior=[AttackLaw(mean=[0.0], std=1e5)])
    filter_ = world.filter(
        "s1", update=update, feedthrough=feedthrough, pruning=1e-3, merging=3.0, correction="injection"
    )
    for step, (_, measured) in enumerate(trial(world, rng, 10_000, attacked=lambda k: k % 100 > 50)):
        inbox = [measured["s1"]] * (rng.random() < 0.8) + [*rng.uniform(-20.0, 20.0, (rng.poisson(2.0), 2))]
        filter_.correct(step, [packet(step, "s1", values) for values in inbox])
        for mixture in filter_._density:
            swapped = mixture.covariances.swapaxes(1, 2)
            assert np.array_equal(mixture.covariances, swapped)
            assert np.linalg.eigvalsh(mixture.covariances).min(initial=1.0) > 0.0


def test_a_packet_that_no_hypothesis_allows_is_left_out():
    filter_ = attackable().filter("s1", substitution=0.0)
    filter_.correct(0, [packet(0, "s1", [1e200, -1e200])])
    np.testing.assert_array_equal(filter_.estimate(0).state, [1.0, -1.0])
    assert filter_.estimate(0).detections[0].alarm


def test_late_and_misshapen_packets_and_copies_change_nothing():
    world = attackable()
    plain, disturbed = world.filter("s1"), world.filter("s1")
    for step in range(3):
        good = packet(step, "s1", [1.0, float(step)])
        plain.correct(step, [good])
        disturbed.correct(step, [packet(step, "s1", [1.0]), good, packet(step - 1, "s1", [9.0, 9.0]), good])
    assert np.array_equal(plain.estimate(2).state, disturbed.estimate(2).state)
    assert len(disturbed.estimate(2).detections) == 1


def test_pruning_and_merging_keep_the_mixtures_small_and_the_estimate_close():
    world, rng = attackable(), np.random.default_rng(8)
    full = world.filter("s1", output="mmse", max_components=4000)
    small = world.filter("s1", output="mmse", pruning=1e-3, merging=0.5, max_components=30)
    for step, (_, measured) in enumerate(trial(world, rng, 5)):
        inbox = [packet(step, "s1", v) for v in (measured["s1"], rng.uniform(-20.0, 20.0, 2))]
        full.correct(step, inbox)
        small.correct(step, inbox)
        np.testing.assert_allclose(small.estimate(step).state, full.estimate(step).state, atol=0.05)
        r = [one.estimate(step).diagnostics["attack_probability"] for one in (full, small)]
        assert r[0] == pytest.approx(r[1], abs=0.03)
    assert small._density.safe.size <= 30 < full._density.safe.size


def test_what_it_published_does_not_change_afterwards():
    world = attackable()
    filter_ = world.filter("s1")
    filter_.correct(0, [packet(0, "s1", [1.0, 0.0])])
    belief = filter_.estimate(0)
    state, covariance = belief.state.copy(), belief.covariance.copy()
    filter_.correct(1, [packet(1, "s1", [1.0, 2.0])])
    assert np.array_equal(belief.state, state)
    assert np.array_equal(belief.covariance, covariance)


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


def refused(world, match, *names, **parameters):
    with pytest.raises(ValueError, match=match):
        world.filter(*names, **parameters)


def test_a_direction_of_the_attack_that_nothing_shows_is_refused_by_name():
    world = attackable(2)
    refused(
        world, r"e1: \(H\)' S\^-1 H is singular: .* in the direction \[-?0.0, -?1.0\]; add a sensor", "s1"
    )
    world.filter("s1", "s2")
    world.filter("s1", feedthrough=False)


def test_the_form_with_feedthrough_refuses_sensors_that_the_attack_does_not_reach():
    world = attackable()
    world.sensors["s1"].H = None
    refused(world, "e1: H is zero: .*; set 'feedthrough: false'", "s1")
    world.filter("s1", feedthrough=False)
    world.plant.G = np.zeros((2, 0))
    refused(world, "e1: C G is zero: .*; let G reach what is measured", "s1", feedthrough=False)


def test_parameters_that_make_no_sense_together_are_refused():
    world = attackable()
    refused(world, "needs a 'mean'", attack_prior=[AttackLaw(std=1.0)])
    refused(
        world,
        "all of one length",
        attack_prior=[AttackLaw([1.0], mean=[1.0]), AttackLaw(1.0, mean=[1.0, 2.0])],
    )
    refused(
        world, "singular; give every component a positive std", attack_prior=[AttackLaw(std=0.0, mean=[1.0])]
    )
    refused(world, "must be positive", attack_prior=[AttackLaw(std=1.0, mean=[1.0], weight=0.0)])
    refused(world, "give 'low' below 'high'", fakes=FakeBox(1.0, 1.0))
    refused(world, "a sensor 2; give one number", fakes=FakeBox([0.0] * 3, 1.0))
    refused(world, "G of Linear has the shape", attack_prior=[AttackLaw(std=1.0, mean=[1.0, 1.0, 1.0])])


def test_models_that_are_not_linear_need_other_moments(not_linear):
    setting = attackable().setting("s1")
    parameters = {
        "attack_prior": [AttackLaw(mean=[1.0], std=1.0)],
        "fakes": FakeBox(-1.0, 1.0),
        "attack_birth": 0.1,
        "attack_survival": 0.9,
    }
    with pytest.raises(ValueError, match="e1: plant SimpleNamespace is not linear; use a linear plant, or"):
        HybridBernoulli(replace(setting, plant=not_linear.plant), **parameters)
    with pytest.raises(ValueError, match=r"sensor s9 .* has no model that this method knows"):
        HybridBernoulli(replace(setting, sensors={"s9": not_linear.sensor}), **parameters)


def test_beside_a_hard_box_a_packet_outside_it_is_genuine_and_two_such_are_impossible():
    inside, outside = [0.5, -1.0], [4.0, 4.0]
    for correction in ("by_arrival", "injection"):
        parameters = {"fakes": FakeBox(-2.0, 2.0, hard=True), "correction": correction, "output": "mmse"}
        filter_ = attackable().filter("s1", **parameters)
        filter_.correct(0, [packet(0, "s1", outside)])
        assert [one.statistic for one in filter_.estimate(0).detections] == [0.0]
        filter_.correct(1, [packet(1, "s1", inside), packet(1, "s1", outside)])
        assert [one.statistic for one in filter_.estimate(1).detections] == [1.0, 0.0]
        filter_.correct(2, [packet(2, "s1", outside), packet(2, "s1", [5.0, 5.0])])
        assert [one.statistic for one in filter_.estimate(2).detections] == [1.0, 1.0]


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
