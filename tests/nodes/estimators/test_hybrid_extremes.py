"""The hybrid Bernoulli filter under whatever arrives: gross, late, numerous, and for very long."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nodes.estimators.attack_prior import AttackLaw
from nodes.estimators.packet_sets import FakeBox
from tests.nodes.estimators.attacked_world import CHANCES, attackable, packet, trial
from tests.nodes.estimators.hybrid_oracles import enumerate_hypotheses

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
    chosen = {**CHANCES, "correction": "by_arrival", "substitution": 0.0}
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
