from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from channel.attacks.worst_case_bias import WorstCaseBias, worst_shift
from tests.channel.adversaries import added_by, known, placement

A = np.array([[0.9, 0.2], [0.0, 0.7]])
C = {"s1": [[1.0, 0.0]], "s2": [[0.0, 1.0], [1.0, 1.0]]}
KNOWN = known(A.tolist(), None, C, ["s1", "s2"])
K, S = (np.array(KNOWN["estimators"]["e1"][name]) for name in ("K", "S"))
STACKED = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
BUDGET = 2.0


def shifts(active: Any, steps: int, **parameters: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return how the settled filter's innovations (steps, m) and estimates (steps, n) are shifted."""
    stage = WorstCaseBias(placement(KNOWN, "s1->e1", "s2->e1"), budget=BUDGET, **parameters)
    added = np.hstack(
        [
            added_by(stage.lane(f"{sensor}->e1"), [0.0] * len(own), active, steps)[0]
            for sensor, own in C.items()
        ]
    )
    estimate, innovations, estimates = np.zeros(2), [], []
    for values in added:
        innovation = values - STACKED @ A @ estimate
        estimate = A @ estimate + K @ innovation
        innovations.append(innovation)
        estimates.append(estimate)
    return np.array(innovations), np.array(estimates)


def test_every_innovation_is_shifted_by_one_vector_of_the_size_of_the_budget() -> None:
    innovations, estimates = shifts(lambda step: step >= 3, 60)
    assert not innovations[:3].any()
    np.testing.assert_allclose(innovations[3:], np.tile(innovations[3], (57, 1)), rtol=1e-9)
    delta = innovations[3]
    assert delta @ np.linalg.solve(S, delta) == pytest.approx(BUDGET)
    limit = np.linalg.solve(np.eye(2) - A, K @ delta)
    np.testing.assert_allclose(estimates[-1], limit, rtol=0.01)


def test_after_a_pause_it_knows_what_is_left_of_its_bias() -> None:
    innovations, _ = shifts(lambda step: step % 4 != 3, 20)
    at_work = [step for step in range(20) if step % 4 != 3]
    np.testing.assert_allclose(innovations[at_work], np.tile(innovations[0], (15, 1)), rtol=1e-9)


@pytest.mark.parametrize("weights", [None, [1.0, 0.0], [0.0, 1.0]])
@pytest.mark.parametrize("horizon", [None, 1, 4])
def test_no_other_direction_of_the_same_size_biases_the_estimate_more(
    weights: list[float] | None, horizon: int | None
) -> None:
    W = np.diag(weights or [1.0, 1.0])
    powers = [np.linalg.matrix_power(A, power) for power in range(horizon or 400)]
    reach = W @ sum(powers) @ K
    parameters = {"weights": weights, "horizon": horizon}
    innovations, _ = shifts(lambda step: True, 1, **parameters)
    worst = np.linalg.norm(reach @ innovations[0])
    directions = np.random.default_rng(0).standard_normal((2000, 3)) @ np.linalg.cholesky(S).T
    sizes = np.sqrt(np.einsum("ij,ij->i", directions, np.linalg.solve(S, directions.T).T))
    others = np.linalg.norm((np.sqrt(BUDGET) * directions / sizes[:, None]) @ reach.T, axis=1)
    assert others.max() <= worst * (1.0 + 1e-9)
    assert others.max() > 0.9 * worst


def test_of_two_opposite_shifts_it_takes_the_one_with_the_positive_effect() -> None:
    for reach in (np.array([[3.0, 1.0]]), np.array([[-3.0, -1.0]])):
        assert reach @ worst_shift(reach, np.eye(2), 1.0) > 0.0


def test_a_plant_that_is_not_stable_has_no_limit_and_takes_the_length_of_its_window() -> None:
    granted = known([[1.0, 0.1], [0.0, 1.0]], None, {"s1": [[1.0, 0.0]]}, ["s1"])
    stage = WorstCaseBias(placement(granted, "s1->e1"), budget=1.0)
    added, _ = added_by(stage.lane("s1->e1"), [0.0], lambda step: True, 100)
    assert added[-1, 0] > 10.0 * added[0, 0] > 0.0


def test_all_sensors_of_an_estimator_are_needed() -> None:
    with pytest.raises(ValueError, match="e1 also listens to s2; attack the links of all its sensors"):
        WorstCaseBias(placement(KNOWN, "s1->e1"), budget=1.0)


def test_weights_that_do_not_fit_the_state_are_refused() -> None:
    with pytest.raises(ValueError, match="'weights' has 1 entries for 2 state components"):
        WorstCaseBias(placement(KNOWN, "s1->e1", "s2->e1"), budget=1.0, weights=[1.0])
