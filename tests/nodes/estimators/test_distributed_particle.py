from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from bus.packets import Packet
from nodes.contract import Setting
from nodes.estimators.distributed_particle import DistributedParticle
from nodes.estimators.distributed_particle_fdi import DistributedParticleFdi
from nodes.estimators.kalman import Kalman
from nodes.estimators.particle import Particle
from nodes.estimators.particle_fdi import ParticleFdi
from nodes.gaussian import Gaussian
from nodes.plants.quadruple_tank import QuadrupleTank
from nodes.sensors.linear import Linear as LinearSensor

PLANT = QuadrupleTank(1.0)
FALSE_ALARM = 1e-6
NAMES = ("e1", "e2")


def network(world, particles, seed=0, kind=DistributedParticle, **options):
    """Return two filters of the small world on a complete graph, each with a sensor of its own."""
    made = {}
    for index, name in enumerate(NAMES):
        own = world.setting(f"s{index + 1}", neighbours={NAMES[1 - index]: 1.0})
        own = replace(own, name=name, rng=np.random.default_rng([seed, index]))
        made[name] = kind(own, particles=particles, **options)
    return made


def step_of(filters, step, packets, *, lost=()):
    """Give every filter its sensor's packet and then what the others send, save for lost links (to, from)."""
    payloads = {}
    for index, (name, own) in enumerate(filters.items()):
        payloads[name] = own.correct(step, [p for p in packets if p.source == f"s{index + 1}"])
    for name, own in filters.items():
        arrived = [
            Packet(other, step, step, "exchange", payload)
            for other, payload in payloads.items()
            if other != name and payload is not None and (name, other) not in lost
        ]
        own.exchange(step, 0, arrived)
    return {name: own.estimate(step) for name, own in filters.items()}


def test_on_a_complete_graph_every_node_is_the_centralised_kalman_filter(world):
    """Within the Monte Carlo error: six deviations, whose variance is ten times ``sigma^2 / ESS``."""
    central, filters = Kalman(world.setting("s1", "s2")), network(world, 50_000)
    _, packets = world.trial(0, 6)
    for step in range(6):
        central.correct(step, packets[step])
        expected = central.estimate(step)
        sigma = np.sqrt(np.diag(expected.covariance))
        for found in step_of(filters, step, packets[step]).values():
            bound = 6.0 * np.sqrt(10.0 / found.diagnostics["effective_sample_size"])
            assert np.all(np.abs(found.state - expected.state) < bound * sigma)
            scale = np.outer(sigma, sigma)
            assert np.all(np.abs(found.covariance - expected.covariance) < 2.0 * bound * scale)
            assert bound < 0.6
            assert found.diagnostics["neighbours_received"] == 1.0


def test_its_error_against_the_centralised_filter_falls_with_the_root_of_the_number(world):
    def error(particles):
        errors = []
        for seed in range(12):
            central, filters = Kalman(world.setting("s1", "s2")), network(world, particles, seed)
            _, packets = world.trial(seed, 4)
            for step in range(4):
                central.correct(step, packets[step])
                expected = central.estimate(step)
                sigma = np.sqrt(np.diag(expected.covariance))
                beliefs = step_of(filters, step, packets[step]).values()
                errors += [(found.state - expected.state) / sigma for found in beliefs]
        return np.sqrt(np.mean(np.square(errors)))

    assert 2.5 < error(500) / error(8000) < 6.5


def test_a_lost_exchange_costs_that_measurement_and_nothing_else(world):
    """A node that misses its neighbour in some steps is the Kalman filter that misses that sensor there."""
    lossy = {1, 3}
    partial, filters = Kalman(world.setting("s1", "s2")), network(world, 50_000)
    _, packets = world.trial(1, 5)
    for step in range(5):
        lost = [("e1", "e2")] if step in lossy else []
        partial.correct(step, [p for p in packets[step] if p.source == "s1" or step not in lossy])
        found, expected = step_of(filters, step, packets[step], lost=lost)["e1"], partial.estimate(step)
        bound = 6.0 * np.sqrt(10.0 / found.diagnostics["effective_sample_size"])
        sigma = np.sqrt(np.diag(expected.covariance))
        assert np.all(np.abs(found.state - expected.state) < bound * sigma)
        assert found.diagnostics["neighbours_received"] == float(step not in lossy)


def test_its_errors_are_as_large_as_it_claims(world):
    """NEES over independent runs, at both nodes; false-alarm rate 1e-6, and 5 % are for 2000 particles."""
    runs, nees = 60, dict.fromkeys(NAMES, 0.0)
    for seed in range(runs):
        filters = network(world, 2000, seed)
        states, packets = world.trial(seed, 5)
        for step in range(5):
            beliefs = step_of(filters, step, packets[step])
        for name, belief in beliefs.items():
            error = belief.state - states[-1]
            nees[name] += error @ np.linalg.solve(belief.covariance, error)
    low, high = chi2.interval(1.0 - FALSE_ALARM, df=3 * runs)
    assert all(0.95 * low < figure < 1.05 * high for figure in nees.values())


def level(index, neighbours=("e2",), seed=0):
    row = np.eye(4)[[index]].tolist()
    sensors = {f"s{index + 1}": LinearSensor(PLANT, C=row, noise=Gaussian(std=0.03))}
    weights = dict.fromkeys(neighbours, 1.0 / len(neighbours)) if neighbours else {}
    return Setting("e1", PLANT, sensors, weights, np.random.default_rng(seed), told_attacks=True)


def test_without_neighbours_it_is_the_filter_that_works_alone():
    pairs = [
        (DistributedParticle(level(0), particles=100), Particle(level(0), particles=100)),
        (
            DistributedParticleFdi(level(0), particles=100, minimum_attack=0.2),
            ParticleFdi(level(0), particles=100, minimum_attack=0.2),
        ),
    ]
    for own, alone in pairs:
        for step in range(20):
            value = PLANT.initial_mean[:1] + 0.3 * (step % 3 == 2)
            packets = [Packet("s1", step, step, "measurement", value)]
            own.correct(step, packets)
            own.exchange(step, 0, [])
            alone.correct(step, packets)
            one, other = own.estimate(step), alone.estimate(step)
            assert np.array_equal(one.state, other.state)
            assert [d.alarm for d in one.detections] == [d.alarm for d in other.detections]


def test_what_it_tells_the_neighbours_of_an_attacked_packet_is_what_is_left_of_it():
    """Two filters that draw alike: one is attacked and told of it, the other one is not attacked."""
    options = {"particles": 100, "minimum_attack": 0.2, "attack_estimate": "oracle"}
    attacked, clean = (DistributedParticleFdi(level(0), **options) for _ in range(2))
    attack = np.array([0.5])
    for step in range(10):
        value = PLANT.initial_mean[:1] + 0.01 * (-1) ** step
        told = [Packet("s1", step, step, "oracle", attack)]
        sent = attacked.correct(step, [Packet("s1", step, step, "measurement", value + attack), *told])
        same = clean.correct(step, [Packet("s1", step, step, "measurement", value), *told])
        np.testing.assert_allclose(sent, same, rtol=1e-6, atol=1e-6)
        assert attacked.estimate(step).detections[0].alarm
        assert not clean.estimate(step).detections[0].alarm


def test_a_step_without_a_measurement_is_a_quiet_slot_and_odd_packets_count_for_nothing():
    own, plain = (DistributedParticle(level(0), particles=100) for _ in range(2))
    assert own.correct(0, []) is None
    plain.correct(0, [])
    late = Packet("e2", -1, 0, "exchange", np.zeros(18))
    short = Packet("e2", 0, 0, "exchange", np.ones(3))
    bent = np.zeros(18)
    bent[8] = -1.0
    own.exchange(0, 0, [late, short])
    assert own.estimate(0).diagnostics["neighbours_received"] == 0.0
    own.exchange(0, 0, [Packet("e2", 0, 0, "exchange", bent)])
    assert own.estimate(0).diagnostics["neighbours_received"] == 0.0
    assert np.array_equal(own.estimate(0).state, plain.estimate(0).state)


def test_fewer_particles_than_a_quadratic_needs_are_refused():
    with pytest.raises(ValueError, match="29 particles are too few; give at least 30"):
        DistributedParticle(level(0), particles=29)
    assert DistributedParticleFdi(level(0), particles=30, minimum_attack=0.2).rounds == 1
