from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from channel.attacks.covert import Covert
from tests.channel.adversaries import added_by, known, placement

A = np.array([[0.9, 0.2], [0.0, 0.7]])
B = np.array([[0.0], [1.0]])
C = {"s1": np.array([[1.0, 0.0]]), "s2": np.array([[1.0, 1.0], [0.0, 2.0]])}
LINKS = ("c1->plant", "s1->e1", "s2->e1")


def granted(dynamics: np.ndarray = A) -> dict[str, Any]:
    return known(dynamics.tolist(), B.tolist(), {name: own.tolist() for name, own in C.items()}, ["s1", "s2"])


def attack(*links: str, value: Any = 2.0, dynamics: np.ndarray = A) -> Covert:
    return Covert(placement(granted(dynamics), *(links or LINKS), first=2, last=5), value=value)


def moved(steps: int, active: Any, dynamics: np.ndarray = A) -> np.ndarray:
    """Return x_a (steps, n)."""
    states = [np.zeros(2)]
    for step in range(steps - 1):
        states.append(dynamics @ states[-1] + (B @ [2.0] if active(step) else 0.0))
    return np.array(states)


@pytest.mark.parametrize(
    "active", [lambda step: 2 <= step <= 5, lambda step: 2 <= step <= 5 and step % 2], ids=["window", "when"]
)
def test_measurements_lose_what_the_added_input_brought_in_the_window_and_after_it(active: Any) -> None:
    stage, steps = attack(), 30
    inputs, _ = added_by(stage.lane("c1->plant"), [1.0], active, steps)
    assert [bool(added) for added in inputs[:, 0]] == [bool(active(step)) for step in range(steps)]
    for sensor, own in C.items():
        added, _ = added_by(stage.lane(f"{sensor}->e1"), [5.0] * len(own), active, steps)
        np.testing.assert_allclose(added, -moved(steps, active) @ own.T, atol=1e-12)


def test_a_genuine_packet_is_passed_on_as_it_is_before_the_window_and_once_all_has_died_away() -> None:
    stage = attack(dynamics=0.5 * A)
    _, ledger = added_by(stage.lane("s2->e1"), [0.0, 0.0], lambda step: 2 <= step <= 5, 200)
    noted = [event.sequence for event in ledger.events]
    assert noted == list(range(3, len(noted) + 3))
    assert 20 < len(noted) < 80


def test_what_does_not_die_away_is_taken_out_for_ever() -> None:
    dynamics = np.array([[1.0, 0.1], [0.0, 1.0]])
    stage = attack(dynamics=dynamics)
    added, _ = added_by(stage.lane("s1->e1"), [0.0], lambda step: 2 <= step <= 5, 90)
    np.testing.assert_allclose(
        added, -moved(90, lambda step: 2 <= step <= 5, dynamics) @ C["s1"].T, atol=1e-12
    )
    assert added[-1, 0] < added[-2, 0] < 0.0


@pytest.mark.parametrize("links", [("c1->plant",), ("s1->e1", "s2->e1")])
def test_it_needs_the_link_of_the_input_and_those_of_sensors(links: tuple[str, ...]) -> None:
    with pytest.raises(ValueError, match=r"write 'on: \[c1->plant, s\*->\*\]'"):
        attack(*links)


def test_a_value_that_does_not_fit_the_input_is_refused() -> None:
    with pytest.raises(ValueError, match="'value' has 2 entries, and the plant's input 1"):
        attack(value=[1.0, 2.0])


def test_it_is_for_plants_with_a_control_link() -> None:
    assert Covert.needs_control_link
    assert Covert.needs == {"model"}
