"""What the extended and the unscented Kalman filter have in common."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from bus.packets import Packet
from nodes.contract import Setting
from nodes.estimators.extended_kalman import ExtendedKalman
from nodes.estimators.kalman import Kalman
from nodes.estimators.particle import Particle
from nodes.estimators.unscented_kalman import UnscentedKalman
from nodes.gaussian import Gaussian
from nodes.plants.linear import Linear as LinearPlant
from nodes.plants.quadruple_tank import QuadrupleTank
from nodes.sensors.innovation import Innovation
from nodes.sensors.linear import Linear as LinearSensor
from nodes.sensors.tank_outflow import TankOutflow

FALSE_ALARM = 1e-6
both = pytest.mark.parametrize("kind", [ExtendedKalman, UnscentedKalman])


def tanks(period_s=5.0, std=0.3):
    """Return a plant that starts far from rest, a flow meter at each lower outlet, and a level in tank 3."""
    plant = QuadrupleTank(
        period_s,
        process_noise=Gaussian(std=0.05),
        initial=Gaussian(std=std, mean=[9.0, 16.0, 3.0, 3.0]),
    )
    sensors = {
        "s1": TankOutflow(plant, tanks=[1, 2], noise=Gaussian(std=0.05)),
        "s2": LinearSensor(plant, C=[[0.0, 0.0, 1.0, 0.0]], noise=Gaussian(std=0.1)),
    }
    return Setting("e1", plant, sensors, {}, np.random.default_rng(0))


@pytest.mark.parametrize(
    ("kind", "parameters"),
    [
        (ExtendedKalman, {}),
        (UnscentedKalman, {}),
        (UnscentedKalman, {"alpha": 0.5, "beta": 2.0, "kappa": 1.0}),
    ],
)
@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), arrives=st.lists(st.tuples(st.booleans(), st.booleans()), max_size=25))
def test_on_a_linear_model_it_is_the_kalman_filter_whatever_is_lost(world, kind, parameters, seed, arrives):
    setting = world.setting("s1", "s2")
    kalman, other = Kalman(setting), kind(setting, **parameters)
    _, packets = world.trial(seed, len(arrives) + 1)
    for step, delivered in enumerate(arrives):
        inbox = [p for p, came in zip(packets[step], delivered, strict=True) if came]
        kalman.correct(step, inbox)
        other.correct(step, inbox)
        expected, found = kalman.estimate(step), other.estimate(step)
        np.testing.assert_allclose(found.state, expected.state, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(found.covariance, expected.covariance, rtol=1e-9, atol=1e-9)
        assert found.nis == pytest.approx(expected.nis, rel=1e-8, abs=1e-8)
        assert found.nis_dof == expected.nis_dof
        assert np.array_equal(found.covariance, found.covariance.T)


@both
def test_on_flow_meters_its_errors_and_innovations_are_as_large_as_it_claims(packet, kind):
    runs, steps = 150, 12
    nees, nis, dof = [], [], 0
    for seed in range(runs):
        setting, rng = tanks(), np.random.default_rng(seed)
        other = kind(setting)
        state = setting.plant.initial_state(rng)
        for step in range(steps):
            if step:
                state = setting.plant.advance(step, state, rng)
            inbox = [packet(step, name, s.observe(step, state, rng)) for name, s in setting.sensors.items()]
            other.correct(step, inbox)
            belief = other.estimate(step)
            nis.append(belief.nis)
            dof += belief.nis_dof
        error = belief.state - state
        nees.append(error @ np.linalg.solve(belief.covariance, error))
    low, high = chi2.interval(1.0 - FALSE_ALARM, df=4 * runs)
    assert low < sum(nees) < high
    low, high = chi2.interval(1.0 - FALSE_ALARM, df=dof)
    assert dof == 3 * runs * steps
    assert low < sum(nis) < high


def test_the_unscented_prediction_has_the_moments_of_many_samples():
    """From a wide law, half an outflow time later: where a linearisation would no longer do."""
    setting = tanks(period_s=20.0, std=1.0)
    unscented = UnscentedKalman(setting)
    unscented.correct(0, [])
    unscented.correct(1, [])
    belief, rng, draws = unscented.estimate(1), np.random.default_rng(0), 200_000
    samples = setting.plant.sample(setting.plant.sample_initial(draws, rng), rng)
    sigma = np.sqrt(np.diag(belief.covariance))
    assert np.all(np.abs(samples.mean(axis=0) - belief.state) < 0.05 * sigma)
    np.testing.assert_allclose(samples.std(axis=0), sigma, rtol=0.03)


@pytest.mark.parametrize("kind", [ExtendedKalman, UnscentedKalman, Particle])
def test_a_commanded_input_moves_the_prediction_as_it_moves_the_plant(kind):
    plant = LinearPlant(
        0.1,
        A=[[1.0, 0.1], [0.0, 1.0]],
        B=[[0.0], [2.0]],
        process_noise=Gaussian(std=1e-9),
        initial=Gaussian(std=1e-9, mean=[1.0, 1.0]),
    )
    other = kind(Setting("e1", plant, {}, {}, np.random.default_rng(0)))
    other.correct(0, [])
    other.control(0, [Packet("c1", 0, 0, "control", np.array([0.5]))])
    other.correct(1, [])
    np.testing.assert_allclose(other.estimate(1).state, [1.1, 2.0], atol=1e-7)


@both
def test_a_late_packet_and_a_copy_change_nothing(packet, kind):
    plain, disturbed = kind(tanks()), kind(tanks())
    for step in range(3):
        current = packet(step, "s2", [3.0])
        plain.correct(step, [current])
        disturbed.correct(step, [packet(step - 1, "s2", [99.0]), current, current])
    assert np.array_equal(plain.estimate(2).state, disturbed.estimate(2).state)
    assert plain.estimate(2).nis_dof == disturbed.estimate(2).nis_dof == 1


@both
def test_it_works_alone_and_a_step_without_packets_only_predicts(kind):
    setting = tanks()
    other = kind(setting)
    other.correct(0, [])
    np.testing.assert_array_equal(other.estimate(0).state, setting.plant.initial_mean)
    np.testing.assert_array_equal(other.estimate(0).covariance, setting.plant.initial_covariance)
    assert other.correct(1, []) is None
    assert other.estimate(1).nis_dof == 0
    assert other.rounds == 0
    assert other.exchange(1, 0, []) is None


@both
def test_models_that_it_cannot_use_are_refused_with_the_cure(kind):
    setting = tanks()
    with pytest.raises(ValueError, match="use a plant that satisfies NonlinearPlant"):
        kind(replace(setting, plant=SimpleNamespace()))
    with pytest.raises(ValueError, match=r"sensor s9 .* satisfies NonlinearSensor"):
        kind(replace(setting, sensors={"s9": SimpleNamespace()}))
    exact = TankOutflow(setting.plant, tanks=[1], noise=Gaussian(std=0.0))
    with pytest.raises(ValueError, match="sensor s1 has singular noise; give it a positive std"):
        kind(replace(setting, sensors={"s1": exact}))


def test_points_that_would_lie_nowhere_are_refused():
    with pytest.raises(ValueError, match=r"kappa is -4\.0; give more than -4"):
        UnscentedKalman(tanks(), kappa=-4.0)


@pytest.mark.parametrize("kind", [ExtendedKalman, UnscentedKalman, Particle])
def test_a_sensor_that_sends_innovations_is_refused_with_the_cure(world, kind):
    smart = Innovation(world.plant, C=[[1.0, 0.0, 0.0]], noise=Gaussian(std=0.1))
    with pytest.raises(ValueError, match="sensor s1 sends innovations, not measurements"):
        kind(replace(world.setting("s1"), sensors={"s1": smart}))
