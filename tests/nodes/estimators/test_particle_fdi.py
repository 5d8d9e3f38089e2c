from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from bus.packets import ORACLE, Packet
from nodes.contract import Setting
from nodes.estimators.attack_detection import UpdatedParticles, WeightedResiduals, margin
from nodes.estimators.attack_estimate import ConvergingBiasTracker
from nodes.estimators.particle import Particle
from nodes.estimators.particle_fdi import ParticleFdi
from nodes.gaussian import Gaussian
from nodes.plants.quadruple_tank import QuadrupleTank
from nodes.sensors.linear import Linear as LinearSensor
from nodes.sensors.tank_outflow import TankOutflow

PLANT = QuadrupleTank(1.0)
R = 1e-3 * np.diag([1.0, 1.0, 0.5, 0.5])


def level_sensor(factor=1.0):
    return LinearSensor(PLANT, C=np.eye(4).tolist(), noise=Gaussian(covariance=(factor * R).tolist()))


def setting(sensor=None, told=True, seed=0):
    sensors = {"s1": sensor or level_sensor()}
    return Setting("e1", PLANT, sensors, {}, np.random.default_rng(seed), told_attacks=told)


def gamma(steps, target=0.5):
    """Return the attack (steps, 4)."""
    values = np.zeros((steps, 4))
    for step in range(1, steps):
        values[step] = 0.9 * values[step - 1] + 0.1 * target
    return values


def measured(step, values, told=None):
    packets = [Packet("s1", step, step, "measurement", np.asarray(values, dtype=float))]
    return packets if told is None else [*packets, Packet("s1", step, step, ORACLE, told)]


def playing(estimator, values, told=None):
    beliefs = []
    for step, value in enumerate(values):
        estimator.correct(step, measured(step, value, None if told is None else told[step]))
        beliefs.append(estimator.estimate(step))
    return beliefs


def measurements(sensor, steps, seed=0):
    rng = np.random.default_rng([seed, 5])
    state = PLANT.initial_state(rng)
    values = []
    for step in range(steps):
        state = PLANT.advance(step, state, rng) if step else state
        values.append(sensor.observe(step, state, rng))
    return np.array(values)


@pytest.mark.parametrize(
    ("factor", "singular", "share", "eta"),
    [(1.0, (1 / 11, 1 / 6), 5 / 6, 0.7 / 3), (5.0, (1 / 51, 1 / 26), 25 / 26, 7 / 26)],
)
def test_the_threshold_is_that_of_the_paper(factor, singular, share, eta):
    found = margin(PLANT.Q, np.eye(4), factor * R)
    values = np.linalg.svd(found.gain, compute_uv=False)
    np.testing.assert_allclose(values, sorted((*singular, *singular), reverse=True), atol=1e-12)
    assert found.share == pytest.approx(share, abs=1e-12)
    detector = UpdatedParticles(
        level_sensor(factor), PLANT.Q, PLANT.initial_mean, minimum_attack=0.28, threshold=None
    )
    assert detector.threshold == pytest.approx(eta, abs=1e-12)


def test_the_norms_of_the_attack_are_those_of_the_paper():
    np.testing.assert_allclose(np.linalg.norm(gamma(5), axis=1), [0.0, 0.1, 0.19, 0.271, 0.3439], atol=1e-12)


def test_the_residual_of_an_updated_particle_is_what_the_gain_leaves_of_it():
    rng = np.random.default_rng(0)
    for _ in range(50):
        G, noise = rng.standard_normal((3, 4)), rng.standard_normal((3, 3))
        found = margin(PLANT.Q, G, noise @ noise.T + 0.1 * np.eye(3))
        y, x = rng.standard_normal(3), rng.standard_normal(4)
        updated = x + found.gain @ (y - G @ x)
        np.testing.assert_allclose(y - G @ updated, found.left @ (y - G @ x), atol=1e-12)


def test_for_a_sensor_that_is_not_linear_the_updated_particles_are_measured_again():
    sensor = TankOutflow(PLANT, tanks=[1, 2], noise=Gaussian(std=0.05))
    detector = UpdatedParticles(sensor, PLANT.Q, PLANT.initial_mean, minimum_attack=0.5, threshold=None)
    states = PLANT.sample_initial(30, np.random.default_rng(0))
    values = sensor.measure(PLANT.initial_mean[None])[0] + 0.353
    gain = margin(PLANT.Q, sensor.jacobian(PLANT.initial_mean), sensor.R).gain
    updated = [x + gain @ (values - sensor.measure(x[None])[0]) for x in states]
    large = [np.linalg.norm(values - sensor.measure(x[None])[0]) > detector.threshold for x in updated]
    found = detector.statistic(values, states, sensor.measure(states))
    assert found == np.mean(large)
    assert 0.0 < found < 1.0


@pytest.mark.parametrize("resampling", ["none", "systematic"])
def test_without_a_miss_or_false_alarm_it_is_the_filter_that_was_not_attacked(resampling):
    """The attack begins above the least that is detected; then the adversary's word takes it all out."""
    sensor, steps, checked = level_sensor(), 60, 0
    attack = gamma(steps) + 0.3
    for seed in range(4):
        genuine = measurements(sensor, steps, seed)
        falsified = np.random.default_rng(seed).random(steps) < 0.5
        options = {"particles": 100, "resampling": resampling}
        plain = playing(Particle(setting(seed=seed), **options), genuine)
        own = ParticleFdi(setting(seed=seed), minimum_attack=0.28, attack_estimate="oracle", **options)
        secured = playing(own, genuine + falsified[:, None] * attack, attack)
        wrong = [belief.detections[0].alarm != was for belief, was in zip(secured, falsified, strict=True)]
        until = wrong.index(True) if any(wrong) else steps
        checked += until
        for one, other in zip(plain[:until], secured[:until], strict=True):
            np.testing.assert_allclose(other.state, one.state, rtol=0.0, atol=1e-10)
    assert checked > 120


def test_a_word_with_noise_costs_as_much_noise_and_no_detection():
    sensor, steps = level_sensor(), 40
    values, attack = measurements(sensor, steps), gamma(steps) + 0.3
    estimates = {}
    for source in ("oracle", "noisy_oracle"):
        own = ParticleFdi(setting(), minimum_attack=0.28, attack_estimate=source, particles=100)
        beliefs = playing(own, values + attack, attack)
        assert all(belief.detections[0].alarm for belief in beliefs)
        estimates[source] = np.array(
            [[b.diagnostics[f"attack_s1_{i}"] for i in range(4)] for b in beliefs] - attack
        )
    assert np.all(estimates["oracle"] == 0.0)
    assert 0.07 < estimates["noisy_oracle"].std() < 0.13


def test_an_oracle_that_says_nothing_counts_as_no_attack():
    own = ParticleFdi(setting(), minimum_attack=0.28, attack_estimate="oracle", particles=50)
    (belief,) = playing(own, [PLANT.initial_mean + 0.5])
    assert belief.detections[0].alarm
    assert belief.diagnostics["attack_s1_0"] == 0.0


def test_a_filter_that_tracks_the_attack_itself_does_not_listen_to_the_oracle():
    sensor, attack = level_sensor(), gamma(20) + 0.3
    values = measurements(sensor, 20) + attack
    alone = playing(ParticleFdi(setting(told=False), minimum_attack=0.28, particles=50), values)
    beside = playing(ParticleFdi(setting(), minimum_attack=0.28, particles=50), values, attack + 7.0)
    assert np.array_equal(alone[-1].state, beside[-1].state)


def test_the_tracker_is_the_kalman_filter_of_the_attack():
    F, W, H = np.array([[0.9, 0.1], [0.0, 1.0]]), 1e-6 * np.eye(2), np.array([[1.0, 0.0]])
    s, S = np.zeros(2), np.diag([0.0, 1.0])
    tracker = ConvergingBiasTracker(1, pole=0.9, target_std=1.0, wander_std=1e-3)
    rng = np.random.default_rng(0)
    for step in range(30):
        if step:
            tracker.predict(None)
            s, S = F @ s, F @ S @ F.T + W
        if rng.random() < 0.5:
            innovation, variance = rng.standard_normal(), 0.02
            tracker.update(np.array([innovation]), np.array([variance]))
            K = S @ H.T / (H @ S @ H.T + variance)
            s, S = s + (K * (innovation - s[0])).ravel(), S - K @ H @ S
        np.testing.assert_allclose([tracker.value[0], tracker.variance[0]], [s[0], S[0, 0]], atol=1e-12)


def test_each_sensor_is_judged_and_compensated_for_itself():
    rows = np.eye(4)[:, None].tolist()
    sensors = {f"s{i + 1}": LinearSensor(PLANT, C=rows[i], noise=Gaussian(std=0.02)) for i in range(4)}
    own = ParticleFdi(replace(setting(), sensors=sensors), minimum_attack=0.2, particles=200)
    attack = gamma(60)[:, 0]
    for step in range(60):
        falsified = step >= 6 and step % 2 == 0
        values = PLANT.initial_mean + np.array([0.0, falsified * attack[step], 0.0, 0.0])
        own.correct(step, [Packet(f"s{i + 1}", step, step, "measurement", values[[i]]) for i in range(4)])
        belief = own.estimate(step)
        assert [d.alarm for d in belief.detections] == [False, falsified, False, False]
    np.testing.assert_allclose(belief.state, PLANT.initial_mean, atol=0.05)
    assert belief.diagnostics["attack_s2_0"] == pytest.approx(attack[-1], abs=0.05)


def test_large_attacks_stay_hidden_from_the_normal_filter_only_where_doubles_underflow():
    """The largest likelihood of an attack of norm 2 is about ``exp(-3000)``: no double, but a logarithm."""
    sensor = level_sensor()
    detector = WeightedResiduals(sensor, threshold=0.7 / 3.0)
    states = PLANT.sample(PLANT.sample_initial(100, np.random.default_rng(0)), np.random.default_rng(1))
    predicted = sensor.measure(states)
    statistics, in_doubles = [], []
    for size in (0.0, 0.3, 0.8, 1.5, 2.0):
        values = PLANT.initial_mean + 0.5 * size
        statistics.append(detector.statistic(values, states, predicted) > 0.5)
        likelihood = np.exp(sensor.log_likelihood(values, predicted))
        outside = np.linalg.norm(values - predicted, axis=1) > detector.threshold
        with np.errstate(invalid="ignore"):
            in_doubles.append(likelihood[outside].sum() / likelihood.sum() > 0.5)
    assert statistics == [False, True, True, True, True]
    assert in_doubles == [False, True, True, False, False]


def test_the_detector_of_the_normal_filter_is_a_choice():
    own = ParticleFdi(setting(), minimum_attack=0.28, detector="weighted_residuals", particles=100)
    values = np.repeat(PLANT.initial_mean[None], 3, axis=0) + np.array([[0.0], [0.15], [1.0]])
    alarms = [belief.detections[0].alarm for belief in playing(own, values)]
    assert alarms == [False, True, True]


def test_a_measurement_beyond_all_doubles_raises_an_alarm():
    with np.errstate(over="ignore"):
        for detector in ("updated_particles", "weighted_residuals"):
            own = ParticleFdi(setting(), minimum_attack=0.28, detector=detector, particles=20)
            (belief,) = playing(own, [np.full(4, 1e200)])
            assert belief.detections[0].alarm


def test_the_oracle_is_a_privilege():
    for source in ("oracle", "noisy_oracle"):
        with pytest.raises(
            ValueError, match=r"does not grant; use 'kalman', or name the attacks in 'oracles: \{e1"
        ):
            ParticleFdi(setting(told=False), minimum_attack=0.28, attack_estimate=source)


def test_what_would_raise_false_alarms_or_cannot_be_judged_is_refused():
    with pytest.raises(ValueError, match=r"below p N / \(N - 1\) = 0\.505051; leave it out"):
        ParticleFdi(setting(), minimum_attack=0.28, alpha=0.5, particles=100)
    blind = SimpleNamespace(
        observe=print, measure=lambda states: states, log_likelihood=lambda values, predicted: predicted[:, 0]
    )
    with pytest.raises(ValueError, match=r"sensor s1 .* use a sensor that satisfies NonlinearSensor"):
        ParticleFdi(setting(blind), minimum_attack=0.28)
