"""The filter that learns from silence: its oracle, and its consistency over independent runs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from scipy.stats import chi2

from bus.packets import Packet
from bus.random_streams import random_stream
from nodes.contract import Setting
from nodes.estimators.event_triggered_kalman import EventTriggeredKalman
from nodes.estimators.kalman import Kalman
from nodes.triggers.contract import TriggerSetting
from nodes.triggers.deterministic_innovation import DeterministicInnovation
from nodes.triggers.periodic import Periodic
from nodes.triggers.send_on_delta import SendOnDelta
from nodes.triggers.stochastic_innovation import StochasticInnovation

TRIGGERS = {
    "stochastic": lambda setting: StochasticInnovation(setting, Y=8.0),
    "open": lambda setting: StochasticInnovation(setting, Y=0.5, loop="open"),
    "deterministic": lambda setting: DeterministicInnovation(setting, threshold=1.2),
    "delta": lambda setting: SendOnDelta(setting, threshold=0.8, norm="largest"),
}


def trigger_of(world, name: str, make, seed: int = 0):
    rng = random_stream(0, seed, name, "trigger")
    return make(TriggerSetting(name, world.plant, world.sensors[name], rng))


def filter_of(world, make, *heard: str, silence: str = "informative") -> EventTriggeredKalman:
    setting: Setting = world.setting(*heard)
    copies = {name: trigger_of(world, name, make) for name in heard}
    return EventTriggeredKalman(replace(setting, sensor_triggers=copies), silence=silence)


def sent_packets(world, make, heard, packets, seed: int = 0):
    """Yield the packets of each step that the triggers of the sensors let pass."""
    triggers = {name: trigger_of(world, name, make, seed) for name in heard}
    for step, row in enumerate(packets):
        yield [p for p in row if p.source in heard and triggers[p.source].sends(step, p.values)]


@pytest.mark.parametrize("heard", [("s1",), ("s1", "s2")])
def test_with_stochastic_triggers_it_is_a_kalman_filter_that_measures_the_prediction(world, heard):
    """Filterpy, given in each silence the value ``C x^-`` of the sensor's filter, noise R + Y^-1."""
    make = TRIGGERS["stochastic"]
    _, packets = world.trial(3, 60)
    own = filter_of(world, make, *heard)
    copies = {name: trigger_of(world, name, make) for name in heard}
    oracle = KalmanFilter(dim_x=3, dim_z=1)
    oracle.x, oracle.P = world.plant.initial_mean[:, None].copy(), world.plant.initial_covariance.copy()
    oracle.F, oracle.Q = world.plant.A, world.plant.Q
    quiet = 0
    for step, row in enumerate(sent_packets(world, make, heard, packets)):
        own.correct(step, row)
        if step:
            oracle.predict()
        came = {packet.source: packet.values for packet in row}
        for name in sorted(heard, key=lambda name: name not in came):
            sensor = world.sensors[name]
            told = copies[name].silence(step)
            value, R = came.get(name, told.centre), sensor.R
            if name not in came:
                R = R + np.eye(len(R)) / 8.0
                quiet += 1
            oracle.dim_z = len(R)
            oracle._I = np.eye(3)
            oracle.update(value[:, None], R=R, H=sensor.C)
            copies[name].note(step, came.get(name))
        belief = own.estimate(step)
        np.testing.assert_allclose(belief.state, oracle.x[:, 0], atol=1e-10)
        np.testing.assert_allclose(belief.covariance, oracle.P, atol=1e-10)
    assert quiet > 10


def test_given_silence_the_deterministic_covariance_is_that_of_the_paper(world):
    """P = P^- - beta P^- C' S^-1 C P^-, beta = sqrt(2/pi) d exp(-d^2/2) / (1 - 2 Q(d)) (Wu 2013)."""
    from scipy.stats import norm

    own = filter_of(world, TRIGGERS["deterministic"], "s1")
    own.correct(0, [])
    P, sensor = world.plant.initial_covariance, world.sensors["s1"]
    PC = P @ sensor.C.T
    beta = 2 * 1.2 * norm.pdf(1.2) / (1 - 2 * norm.sf(1.2))
    expected = P - beta * PC @ np.linalg.solve(sensor.C @ PC + sensor.R, PC.T)
    np.testing.assert_allclose(own.estimate(0).covariance, expected, atol=1e-12)
    np.testing.assert_allclose(own.estimate(0).state, world.plant.initial_mean, atol=1e-12)


def test_when_silence_is_ignored_or_says_nothing_it_is_the_plain_filter(world):
    _, packets = world.trial(1, 40)
    for make, silence in (
        (TRIGGERS["stochastic"], "ignored"),
        (lambda s: Periodic(s, every=3), "informative"),
    ):
        own, plain = filter_of(world, make, "s1", silence=silence), Kalman(world.setting("s1"))
        for step, row in enumerate(sent_packets(world, make, ("s1",), packets)):
            own.correct(step, row)
            plain.correct(step, row)
            assert np.array_equal(own.estimate(step).state, plain.estimate(step).state)
            assert np.array_equal(own.estimate(step).covariance, plain.estimate(step).covariance)


@pytest.mark.parametrize("name", TRIGGERS)
def test_it_is_consistent_where_silence_counts(world, name):
    """Mean NEES of the last step over 300 independent runs; false-alarm rate 1e-6.

    Exact for the stochastic triggers; the box is a moment match that passes as well.
    """
    runs, steps, make = 300, 12, TRIGGERS[name]
    total, silent = 0.0, 0.0
    for run in range(runs):
        states, packets = world.trial(1000 + run, steps)
        own = filter_of(world, make, "s1", "s2")
        for step, row in enumerate(sent_packets(world, make, ("s1", "s2"), packets, run)):
            own.correct(step, row)
            silent += own.estimate(step).diagnostics["silent"]
        belief = own.estimate(steps - 1)
        error = belief.state - states[-1]
        total += float(error @ np.linalg.solve(belief.covariance, error))
    low, high = chi2.interval(1 - 1e-6, df=runs * 3)
    assert low < total < high
    assert silent > runs * steps * 0.1


def test_to_learn_from_silence_is_better_than_not(world):
    """Same packets; the mean squared error over 200 runs of 12 steps."""
    make = lambda setting: StochasticInnovation(setting, Y=0.5)  # noqa: E731
    errors = np.zeros(2)
    for run in range(200):
        states, packets = world.trial(run, 12)
        pair = [filter_of(world, make, "s1", silence=silence) for silence in ("informative", "ignored")]
        for step, row in enumerate(sent_packets(world, make, ("s1",), packets, run)):
            for i, own in enumerate(pair):
                own.correct(step, row)
                errors[i] += np.sum((own.estimate(step).state - states[step]) ** 2)
    assert errors[0] < 0.95 * errors[1]


def test_a_late_packet_counts_as_silence(world):
    own, other = (filter_of(world, TRIGGERS["stochastic"], "s1") for _ in range(2))
    late = Packet("s1", 0, 0, "measurement", np.array([9.0]))
    for step in range(3):
        own.correct(step, [late] if step else [])
        other.correct(step, [])
    assert np.array_equal(own.estimate(2).state, other.estimate(2).state)
