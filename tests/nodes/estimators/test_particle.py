from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2

from nodes.contract import Setting
from nodes.estimators.extended_kalman import ExtendedKalman
from nodes.estimators.kalman import Kalman
from nodes.estimators.particle import Particle
from nodes.estimators.particle_unweighted import ParticleUnweighted
from nodes.gaussian import Gaussian
from nodes.plants.quadruple_tank import QuadrupleTank
from nodes.sensors.linear import Linear as LinearSensor
from nodes.sensors.student_t import StudentT
from nodes.sensors.tank_outflow import TankOutflow

PLANT = QuadrupleTank(1.0)
FALSE_ALARM = 1e-6


def setting(sensor, seed=0):
    return Setting("e1", PLANT, {"s1": sensor}, {}, np.random.default_rng(seed))


def level_sensor(std=0.03):
    return LinearSensor(PLANT, C=np.eye(4).tolist(), noise=Gaussian(std=std))


def measured_states(sensor, seed, steps):
    """Return states (steps, 4) and measurements (steps, m)."""
    rng = np.random.default_rng([seed, 7])
    states = [PLANT.initial_state(rng)]
    for step in range(1, steps):
        states.append(PLANT.advance(step, states[-1], rng))
    return np.array(states), np.array([sensor.observe(k, x, rng) for k, x in enumerate(states)])


def run(estimator, packet, values):
    beliefs = []
    for step, value in enumerate(values):
        estimator.correct(step, [packet(step, "s1", value)])
        beliefs.append(estimator.estimate(step))
    return beliefs


def monte_carlo_errors(world, particles, seeds, steps=6):
    """Return the errors of the mean in units of the Kalman filter's sigma, and the sizes."""
    errors, sizes = [], []
    for seed in seeds:
        own = replace(world.setting("s1", "s2"), rng=np.random.default_rng([seed, 1]))
        kalman, particle = Kalman(own), Particle(own, particles=particles)
        _, packets = world.trial(seed, steps)
        for step in range(steps):
            kalman.correct(step, packets[step])
            particle.correct(step, packets[step])
            expected, found = kalman.estimate(step), particle.estimate(step)
            errors.append((found.state - expected.state) / np.sqrt(np.diag(expected.covariance)))
            sizes.append(found.diagnostics["effective_sample_size"])
    return np.array(errors), np.array(sizes)


def test_with_many_particles_it_agrees_with_the_kalman_filter_within_its_monte_carlo_error(world):
    """The bound: six deviations, whose variance is ten times ``sigma^2 / ESS``.

    A weighted mean has ``sigma^2 / ESS`` of its own. Few particles are near the first measurement, and what
    is lost there is inherited: over 60 runs of 20 000 particles the whole was at most 10 times as large, in
    step 1, and 3 times in the end.
    """
    own = replace(world.setting("s1", "s2"), rng=np.random.default_rng(3))
    kalman, particle = Kalman(own), Particle(own, particles=100_000)
    _, packets = world.trial(0, 8)
    for step in range(8):
        kalman.correct(step, packets[step])
        particle.correct(step, packets[step])
        expected, found = kalman.estimate(step), particle.estimate(step)
        sigma = np.sqrt(np.diag(expected.covariance))
        bound = 6.0 * np.sqrt(10.0 / found.diagnostics["effective_sample_size"])
        assert np.all(np.abs(found.state - expected.state) < bound * sigma)
        scale = np.outer(sigma, sigma)
        assert np.all(np.abs(found.covariance - expected.covariance) < 2.0 * bound * scale)
        assert bound < 0.4


def test_its_monte_carlo_error_falls_with_the_root_of_the_number(world):
    few, _ = monte_carlo_errors(world, 500, range(12))
    many, _ = monte_carlo_errors(world, 8000, range(12))
    assert 2.5 < np.sqrt((few**2).mean() / (many**2).mean()) < 6.5


@pytest.mark.parametrize("resampling", ["systematic", "stratified", "residual"])
def test_with_any_resampling_it_follows_the_tanks_nearly_as_well_as_an_extended_kalman_filter(
    packet, resampling
):
    sensor, square, reference = level_sensor(), 0.0, 0.0
    for seed in range(8):
        states, values = measured_states(sensor, seed, 60)
        particle = Particle(setting(sensor, seed), particles=200, resampling=resampling)
        found = [belief.state for belief in run(particle, packet, values)]
        expected = [belief.state for belief in run(ExtendedKalman(setting(sensor)), packet, values)]
        square += ((found - states) ** 2).sum()
        reference += ((expected - states) ** 2).sum()
    assert np.sqrt(square / reference) < 1.1


def test_without_resampling_one_particle_ends_up_with_all_the_weight(packet):
    sensor = level_sensor()
    _, values = measured_states(sensor, 0, 60)
    own = Particle(setting(sensor), particles=100, resampling="none")
    sizes = [belief.diagnostics["effective_sample_size"] for belief in run(own, packet, values)]
    assert sizes[0] > 20.0
    assert sizes[-1] < 1.3


def test_heavy_tailed_noise_costs_it_less_than_a_filter_that_believes_in_a_covariance(packet):
    """The likelihood tells an outlier from a movement; a covariance does not."""
    sensor = StudentT(PLANT, C=np.eye(4).tolist(), scale=0.02, degrees_of_freedom=2.2)
    square, reference = 0.0, 0.0
    for seed in range(10):
        states, values = measured_states(sensor, seed, 80)
        own = Particle(setting(sensor, seed), particles=500)
        found = [belief.state for belief in run(own, packet, values)]
        expected = [belief.state for belief in run(ExtendedKalman(setting(sensor)), packet, values)]
        square += ((found - states) ** 2).sum()
        reference += ((expected - states) ** 2).sum()
    assert np.sqrt(square / reference) < 0.85


def test_on_flow_meters_its_errors_are_as_large_as_it_claims(packet):
    """With the Monte Carlo error allowed for: N is large enough for a tenth more."""
    sensor, runs, nees = TankOutflow(PLANT, tanks=[1, 2, 3, 4], noise=Gaussian(std=0.05)), 60, 0.0
    for seed in range(runs):
        states, values = measured_states(sensor, seed, 10)
        belief = run(Particle(setting(sensor, seed), particles=1000), packet, values)[-1]
        error = belief.state - states[-1]
        nees += error @ np.linalg.solve(belief.covariance, error)
    low, high = chi2.interval(1.0 - FALSE_ALARM, df=4 * runs)
    assert low < nees < 1.1 * high


def test_a_measurement_far_off_leaves_finite_weights_and_one_beyond_all_doubles_tells_nothing(packet):
    sensor = level_sensor()
    own = Particle(setting(sensor), particles=50)
    own.correct(0, [packet(0, "s1", PLANT.initial_mean + 1e3)])
    assert np.isfinite(own.estimate(0).state).all()
    blind = Particle(setting(sensor), particles=50)
    with np.errstate(over="ignore"):
        blind.correct(0, [packet(0, "s1", np.full(4, 1e200))])
    assert blind.estimate(0).diagnostics["effective_sample_size"] == pytest.approx(50.0)


def test_two_filters_of_one_seed_move_the_same_particles_whatever_they_measure(packet):
    sensor = level_sensor()
    one, other = (Particle(setting(sensor), particles=20, resampling="none") for _ in range(2))
    blind = ParticleUnweighted(setting(sensor), particles=20)
    for step in range(5):
        one.correct(step, [packet(step, "s1", PLANT.initial_mean)])
        other.correct(step, [])
        blind.correct(step, [packet(step, "s1", PLANT.initial_mean + 9.0)])
    assert np.array_equal(other.estimate(4).state, blind.estimate(4).state)
    assert not np.array_equal(other.estimate(4).state, one.estimate(4).state)


def test_a_late_packet_and_a_copy_change_nothing(packet):
    sensor = level_sensor()
    plain, disturbed = (Particle(setting(sensor), particles=20) for _ in range(2))
    for step in range(3):
        current = packet(step, "s1", PLANT.initial_mean)
        plain.correct(step, [current])
        disturbed.correct(step, [packet(step - 1, "s1", PLANT.initial_mean + 1.0), current, current])
    assert np.array_equal(plain.estimate(2).state, disturbed.estimate(2).state)


def test_it_works_alone():
    own = Particle(setting(level_sensor()), particles=20)
    assert own.rounds == 0
    assert own.correct(0, []) is None
    assert own.exchange(0, 0, []) is None


def test_models_without_sampler_or_likelihood_are_refused_with_the_cure():
    own = setting(level_sensor())
    with pytest.raises(ValueError, match="use a plant that satisfies SampledPlant"):
        Particle(replace(own, plant=SimpleNamespace()))
    with pytest.raises(ValueError, match=r"sensor s9 .* satisfies LikelihoodSensor"):
        Particle(replace(own, sensors={"s9": SimpleNamespace()}))
    with pytest.raises(ValueError, match="singular noise has no likelihood; give it a positive std"):
        Particle(setting(level_sensor(0.0)))
