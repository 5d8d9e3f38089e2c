from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from channel.attacks.zero_dynamics import ZeroDynamics
from tests.channel.adversaries import added_by, known, placement

A = [[1.0, 0.1, 0.005], [0.0, 1.0, 0.1], [0.0, 0.0, 1.0]]
B = [[0.1**3 / 6], [0.005], [0.1]]
KNOWN = known(A, B, {"s1": [[1.0, 0.0, 0.0]], "s2": [[0.0, 1.0, 0.0]]}, ["s1"])


def attack(
    first: int = 3, last: int = 12, granted: dict[str, Any] = KNOWN, **parameters: Any
) -> ZeroDynamics:
    return ZeroDynamics(placement(granted, "c1->plant", first=first, last=last), **parameters)


def moved_by(inputs: np.ndarray) -> np.ndarray:
    """Return the motion (steps + 1, n) of a plant at rest under inputs."""
    states = [np.zeros(3)]
    for u in inputs:
        states.append(np.array(A) @ states[-1] + np.array(B) @ u)
    return np.array(states)


def test_the_state_leaves_along_the_zero_while_the_outputs_show_the_start_alone() -> None:
    eps = 1e-3
    stage = attack(amplitude=eps, sensors=["s1"])
    inputs, _ = added_by(stage.lane("c1->plant"), [0.0], lambda step: 3 <= step <= 12, 13)
    assert not inputs[:3].any()
    z, x = stage.zero.z.real, np.real(stage.zero.x)
    assert z == pytest.approx(-2 - np.sqrt(3))
    states = moved_by(inputs[3:])
    for since, state in enumerate(states):
        start = np.linalg.matrix_power(np.array(A), since) @ x
        np.testing.assert_allclose(state, eps * (z**since * x - start), rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(state[0], -eps * start[0], atol=1e-9)
    assert np.linalg.norm(states[-1]) > 100.0


def test_the_zero_that_was_asked_for_is_taken() -> None:
    assert attack(amplitude=1.0, sensors=["s1"], zero=[-0.268]).zero.z.real == pytest.approx(-2 + np.sqrt(3))
    with pytest.raises(ValueError, match=r"1.5 is no invariant zero; there is: -3.73205, -0.267949"):
        attack(amplitude=1.0, sensors=["s1"], zero=[1.5])


def test_a_pair_of_complex_zeros_leaves_the_outputs_quiet_too() -> None:
    turn = [[0.9, 0.9, 0.0], [-0.9, 0.9, 0.5], [1.0, 0.0, 0.3]]
    granted = known(turn, [[0.0], [0.0], [1.0]], {"s1": [[0.2, 0.1, 1.0]]}, ["s1"])
    stage = attack(0, 30, granted, amplitude=0.5)
    assert stage.zero.z.imag > 0.1
    state = 0.5 * np.real(stage.zero.x)
    for since in range(20):
        assert abs(0.2 * state[0] + 0.1 * state[1] + state[2]) < 1e-9 * np.linalg.norm(state)
        state = np.array(turn) @ state + np.array([0.0, 0.0, 1.0]) * stage.input(since)


def test_what_it_does_stands_in_the_ledger() -> None:
    stage = attack(amplitude=2.0, sensors=["s1"])
    inputs, ledger = added_by(stage.lane("c1->plant"), [7.0], lambda step: step in (3, 4), 6)
    assert [event.sequence for event in ledger.events] == [3, 4]
    assert [event.magnitude for event in ledger.events] == pytest.approx(np.abs(inputs[3:5, 0]).tolist())


def test_a_plant_without_zeros_is_refused() -> None:
    with pytest.raises(ValueError, match="no finite invariant zero for these sensors; no input stays hidden"):
        attack(amplitude=1.0)


def test_a_window_in_which_it_would_leave_all_bounds_is_refused() -> None:
    with pytest.raises(ValueError, match="grow beyond 1e\\+12 in steps 3 to 60; end its window earlier"):
        attack(last=60, amplitude=1.0, sensors=["s1"])


def test_an_unknown_sensor_and_a_link_of_another_width_are_named() -> None:
    with pytest.raises(ValueError, match="there is no sensor s7; there is: s1, s2"):
        attack(amplitude=1.0, sensors=["s7"])
    with pytest.raises(ValueError, match="attack shifts 1 values, and a payload on c1->plant has 2"):
        added_by(attack(amplitude=1.0, sensors=["s1"]).lane("c1->plant"), [0.0, 0.0], lambda step: True, 1)
