"""What each event trigger promises, by direct calls."""

from __future__ import annotations

from dataclasses import replace
from math import erfc, exp, sqrt

import numpy as np
import pytest

from nodes.gaussian import Gaussian
from nodes.plants.linear import Linear as LinearPlant
from nodes.sensors.innovation import Innovation
from nodes.sensors.linear import Linear as LinearSensor
from nodes.triggers.contract import BoxSilence, InformativeTrigger, TriggerSetting
from nodes.triggers.deterministic_innovation import DeterministicInnovation
from nodes.triggers.periodic import Periodic
from nodes.triggers.relative import Relative
from nodes.triggers.send_on_delta import SendOnDelta
from nodes.triggers.stochastic_innovation import StochasticInnovation


@pytest.fixture
def plant() -> LinearPlant:
    return LinearPlant(
        0.1, A=[[0.95, 0.2], [-0.2, 0.95]], process_noise=Gaussian(std=0.1), initial=Gaussian(std=1.0)
    )


@pytest.fixture
def setting(plant: LinearPlant) -> TriggerSetting:
    sensor = LinearSensor(plant, C=[[1.0, 0.0]], noise=Gaussian(std=0.3))
    return TriggerSetting("s1", plant, sensor, np.random.default_rng(3))


def of_estimator(setting: TriggerSetting) -> TriggerSetting:
    return replace(setting, name="e1", sensor=None)


def measured(setting: TriggerSetting, steps: int, seed: int = 0) -> np.ndarray:
    """Return the measurements (steps, m) of one run."""
    rng = np.random.default_rng(seed)
    state, rows = setting.plant.initial_state(rng), []
    for step in range(steps):
        state = state if step == 0 else setting.plant.advance(step, state, rng)
        rows.append(setting.sensor.observe(step, state, rng))
    return np.array(rows)


def decisions(trigger, rows) -> np.ndarray:
    return np.array([trigger.sends(step, values) for step, values in enumerate(rows)])


def test_periodic_sends_in_its_phase_only(setting):
    sent = decisions(Periodic(setting, every=4, phase=1), np.zeros((12, 1)))
    assert np.flatnonzero(sent).tolist() == [1, 5, 9]
    with pytest.raises(ValueError, match="phase 4 is not within the period of 4"):
        Periodic(setting, every=4, phase=4)


@pytest.mark.parametrize(("norm", "order"), [("euclidean", 2), ("largest", np.inf)])
def test_send_on_delta_never_leaves_the_receiver_farther_than_the_threshold(setting, norm, order):
    rows = np.cumsum(np.random.default_rng(1).normal(size=(300, 3)), axis=0)
    trigger = SendOnDelta(setting, threshold=2.5, norm=norm)
    last, gaps = None, []
    for step, values in enumerate(rows):
        last = values if trigger.sends(step, values) else last
        gaps.append(np.linalg.norm(values - last, order))
    assert max(gaps) <= 2.5
    assert 0.1 < np.count_nonzero(np.array(gaps) == 0.0) / 300 < 0.9


def test_send_on_delta_may_look_at_some_components_only(setting):
    trigger = SendOnDelta(setting, threshold=1.0, components=[1])
    rows = [[0.0, 0.0], [9.0, 0.5], [0.0, 1.5]]
    assert decisions(trigger, np.array(rows)).tolist() == [True, False, True]
    with pytest.raises(ValueError, match="compares component 1 of 1"):
        decisions(SendOnDelta(setting, threshold=1.0, components=[1]), np.ones((2, 1)))


def test_the_relative_triggers_inequality_holds_between_sends(setting):
    Phi = np.array([[2.0, 0.5], [0.5, 1.0]])
    trigger = Relative(setting, sigma=0.1, Phi=Phi.tolist())
    rng = np.random.default_rng(2)
    last, quiet = None, 0
    for step in range(400):
        z, Psi = rng.normal(size=2), 4.0 * rng.normal(size=2)
        if trigger.sends(step, z, Psi):
            if last is not None:
                assert (z - last) @ Phi @ (z - last) > trigger.bound(Psi)
            last = z
        else:
            quiet += 1
            assert (z - last) @ Phi @ (z - last) <= 0.1 * Psi @ Phi @ Psi + 1e-12
    assert 20 < quiet < 380


def test_without_a_reference_the_relative_trigger_compares_with_the_value_itself(setting):
    sent = decisions(Relative(setting, sigma=0.04), np.array([[10.0], [11.9], [12.6], [12.6]]))
    assert sent.tolist() == [True, False, True, False]


def test_a_zero_sigma_sends_every_change(setting):
    assert decisions(Relative(setting, sigma=0.0), np.array([[1.0], [1.0], [1.1]])).tolist() == [1, 0, 1]


def test_deterministic_innovation_sends_the_tails_of_a_normal_law(setting):
    """Of 4000 slots; bounds of 4.5 standard deviations of a binomial share: 7e-6 false alarms each."""
    for threshold in (0.5, 1.0, 1.5):
        rate = decisions(
            DeterministicInnovation(setting, threshold=threshold), measured(setting, 4000)
        ).mean()
        expected = erfc(threshold / sqrt(2.0))
        assert abs(rate - expected) < 4.5 * sqrt(expected * (1 - expected) / 4000) + 0.01


def test_a_smart_sensors_innovations_are_compared_with_their_covariance(plant):
    sensor = Innovation(plant, C=[[1.0, 0.0]], noise=Gaussian(std=0.3))
    setting = TriggerSetting("s1", plant, sensor, np.random.default_rng(0))
    rate = decisions(DeterministicInnovation(setting, threshold=1.0), measured(setting, 4000)).mean()
    expected = erfc(1.0 / sqrt(2.0))
    assert abs(rate - expected) < 4.5 * sqrt(expected * (1 - expected) / 4000)


def test_the_stochastic_trigger_is_quiet_with_the_probability_that_it_states(setting):
    """20000 draws of one value; 4.5 standard deviations."""
    trigger = StochasticInnovation(setting, Y=2.0, loop="open")
    quiet = 1.0 - np.mean([trigger.sends(k, np.array([0.8])) for k in range(20000)])
    expected = exp(-0.5 * 2.0 * 0.8**2)
    assert abs(quiet - expected) < 4.5 * sqrt(expected * (1 - expected) / 20000)


def test_the_stochastic_trigger_draws_one_number_a_slot_whatever_the_values(setting):
    rng = np.random.default_rng(5)
    trigger = StochasticInnovation(replace(setting, rng=rng), Y=1.0)
    decisions(trigger, measured(setting, 50))
    reference = np.random.default_rng(5)
    reference.random(50)
    assert rng.random() == reference.random()


@pytest.mark.parametrize(
    "make",
    [
        lambda setting: SendOnDelta(setting, threshold=0.5),
        lambda setting: DeterministicInnovation(setting, threshold=1.0),
        lambda setting: StochasticInnovation(setting, Y=5.0),
        lambda setting: StochasticInnovation(setting, Y=5.0, loop="open"),
    ],
)
def test_a_receivers_copy_stays_the_senders_trigger(setting, make):
    sender, copy = make(setting), make(setting)
    assert isinstance(copy, InformativeTrigger)
    for step, values in enumerate(measured(setting, 200)):
        told = copy.silence(step)
        sent = sender.sends(step, values)
        copy.note(step, values if sent else None)
        if isinstance(told, BoxSilence) and not sent:
            assert abs(values[0] - told.centre[0]) <= told.half_width * told.factor[0, 0] * (1 + 1e-12)
    one, other = sender.silence(200), copy.silence(200)
    assert np.array_equal(one.centre, other.centre)


def test_triggers_of_estimators_compare_payloads_and_predict_nothing(setting):
    own = of_estimator(setting)
    assert StochasticInnovation(own, Y=1.0, loop="open").sends(0, np.array([50.0, 1.0]))
    for make in (
        lambda s: DeterministicInnovation(s, threshold=1.0),
        lambda s: StochasticInnovation(s, Y=1.0),
    ):
        with pytest.raises(ValueError, match=r"e1: only a sensor's values are predicted .* send_on_delta"):
            make(own)


def test_what_makes_no_sense_is_refused(setting, plant):
    with pytest.raises(ValueError, match="Phi is not positive definite"):
        Relative(setting, sigma=0.1, Phi=[[1.0, 2.0], [2.0, 1.0]])
    with pytest.raises(ValueError, match="Y is 0; it must be positive"):
        StochasticInnovation(setting, Y=0.0)
    with pytest.raises(ValueError, match="Y has 2 rows for a value of 1 components"):
        StochasticInnovation(setting, Y=[[1.0, 0.0], [0.0, 1.0]])
    driven = LinearPlant(
        0.1,
        A=[[0.9]],
        B=[[1.0]],
        process_noise=Gaussian(std=0.1),
        initial=Gaussian(std=1.0),
    )
    sensor = LinearSensor(driven, C=[[1.0]], noise=Gaussian(std=0.3))
    with pytest.raises(ValueError, match="a plant without input"):
        DeterministicInnovation(TriggerSetting("s1", driven, sensor, setting.rng), threshold=1.0)
