"""A signal in plant and sensors, without noise, against ``x+ = A x + G a`` and ``y = C x + H a`` by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from bus.messages import Message, Transmission, Truth
from bus.plan import Kind, Plan, PlantPlan, SensorPlan, SignalPlan, TimingPlan
from nodes.gaussian import Gaussian
from nodes.signal_attack import Signal, SignalAttacks
from orchestrator.backends.inprocess import run_messages

A = np.array([[1.0, 0.5], [-0.25, 1.0]])
G = np.array([[0.5, 0.0], [1.0, 2.0]])
C = np.array([[1.0, 2.0]])
H = np.array([[4.0, 0.5]])
START = [1.0, -1.0]
STEPS = 12


def signal(label: str, first: int, last: int, when: Kind | None = None, **parameters: Any) -> SignalPlan:
    kind = Kind("nodes.signal_attack:Signal", parameters)
    return SignalPlan(label, kind, "signal", TimingPlan(first, last, when, label, "when"))


def plan_of(*signals: SignalPlan) -> Plan:
    plant = Kind(
        "nodes.plants.linear:Linear",
        {
            "A": A.tolist(),
            "G": G.tolist(),
            "process_noise": Gaussian(std=0.0),
            "initial": Gaussian(std=0.0, mean=START),
        },
    )
    sensor = {"C": C.tolist(), "noise": Gaussian(std=0.0)}
    with_signal = sensor | {"H": H.tolist()}
    return Plan(
        "signals",
        3,
        0,
        STEPS,
        0.1,
        PlantPlan("plant", plant),
        (
            SensorPlan("s1", Kind("nodes.sensors.linear:Linear", with_signal)),
            SensorPlan("s2", Kind("nodes.sensors.linear:Linear", sensor)),
        ),
        (),
        (),
        (),
        signals=signals,
    )


def run(plan: Plan) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Return the states (steps, n), the signal (steps, q), and by sensor what it sent (steps, m)."""
    states, attacks = [], []
    sent: dict[str, list[list[float]]] = {"s1": [], "s2": []}

    def keep(topic: str, message: Message) -> None:
        if isinstance(message, Truth):
            states.append(message.state)
            attacks.append(message.attack)
        elif isinstance(message, Transmission):
            sent[topic.split("/")[1]].append(message.values)

    run_messages(plan, keep)
    return np.array(states), np.array(attacks), {name: np.array(values) for name, values in sent.items()}


def by_hand(signal: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return states (steps, n), and what a sensor with and one without ``H`` measure (steps, m)."""
    states = [np.array(START)]
    for value in signal[:-1]:
        states.append(A @ states[-1] + G @ value)
    with_signal = [C @ x + H @ a for x, a in zip(states, signal, strict=True)]
    return np.array(states), np.array(with_signal), np.array([C @ x for x in states])


def expect(plan: Plan, signal: np.ndarray) -> None:
    states, attacks, sent = run(plan)
    np.testing.assert_array_equal(attacks, signal)
    expected = by_hand(signal)
    for found, wanted in zip((states, sent["s1"], sent["s2"]), expected, strict=True):
        np.testing.assert_allclose(found, wanted, rtol=1e-13, atol=1e-13)


def test_the_value_of_a_step_enters_its_measurements_and_the_next_state() -> None:
    signal_of = np.zeros((STEPS, 2))
    signal_of[4:8] = [10.0, 20.0]
    expect(plan_of(signal("a", 4, 7, value=[10.0, 20.0])), signal_of)


def test_a_series_runs_from_the_first_step_of_its_window_and_its_last_value_stays() -> None:
    signal_of = np.zeros((STEPS, 2))
    signal_of[2], signal_of[3], signal_of[4:7] = [1.0, 0.0], [2.0, 0.0], [3.0, 5.0]
    expect(plan_of(signal("a", 2, 6, series=[[1.0, 0.0], [2.0, 0.0], [3.0, 5.0]])), signal_of)


def test_signals_add_up() -> None:
    signal_of = np.zeros((STEPS, 2))
    signal_of[0:6] += [1.0, 0.0]
    signal_of[4:9] += [0.0, -3.0]
    expect(plan_of(signal("a", 0, 5, value=[1.0, 0.0]), signal("b", 4, 8, value=[0.0, -3.0])), signal_of)


def test_a_switched_signal_is_the_same_in_the_plant_and_in_its_sensors() -> None:
    switching = Kind("bus.schedules:MarkovSchedule", {"start": 0.5, "stop": 0.4})
    plan = plan_of(signal("a", 1, STEPS - 1, switching, value=[1.0, 2.0], noise_std=0.5))
    attacks = run(plan)[1]
    quiet = ~attacks.any(axis=1)
    assert quiet[0]
    assert 0 < quiet[1:].sum() < STEPS - 1
    assert len({tuple(row) for row in attacks[~quiet]}) == (~quiet).sum(), "its noise is drawn anew"
    expect(plan, attacks)


def test_without_a_signal_nothing_is_said_of_one() -> None:
    assert run(plan_of())[1].size == 0


def test_its_draws_are_addressed_by_the_step_whoever_asks_first() -> None:
    plan = plan_of(signal("a", 0, 9, value=[0.0, 0.0], noise_std=1.0))
    forward, backward = SignalAttacks(plan), SignalAttacks(plan)
    ahead = [forward.at(step).tolist() for step in range(10)]
    behind = [backward.at(step).tolist() for step in reversed(range(10))]
    assert ahead == behind[::-1]


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({}, "give exactly one of 'value' and 'series'"),
        ({"value": [1.0], "series": [[1.0]]}, "give exactly one of 'value' and 'series'"),
        ({"series": [[1.0], [1.0, 2.0]]}, "must be of one length"),
        ({"value": []}, "must be of one length, at least 1"),
        ({"value": [1.0], "noise_std": -1.0}, "noise_std must not be negative"),
    ],
)
def test_parameters_that_make_no_sense_are_refused(parameters: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Signal(np.random.default_rng(0), **parameters)


def test_signals_of_different_sizes_are_refused() -> None:
    with pytest.raises(ValueError, match=r"must have as many components: \[1, 2\]"):
        SignalAttacks(plan_of(signal("a", 0, 1, value=[1.0]), signal("b", 0, 1, value=[1.0, 2.0])))
