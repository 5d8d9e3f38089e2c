from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

from bus.packets import Packet
from channel.attacks.optimal_linear import OptimalLinear
from channel.contract import Ledger, Slot
from tests.channel.adversaries import known, placement

FALSE_ALARM = 1e-6
KNOWN = known([[0.9, 0.2], [0.0, 0.7]], None, {"s1": [[1.0, 0.0], [1.0, 1.0]]}, ["s1"])
S = np.array(KNOWN["estimators"]["e1"]["S"])


def attack(link: str = "s1->e1", **parameters: Any) -> OptimalLinear:
    return OptimalLinear(placement(KNOWN, link), **parameters)


def falsified(stage: OptimalLinear, innovations: np.ndarray) -> tuple[np.ndarray, Ledger]:
    lane, ledger = stage.lane("s1->e1"), Ledger()
    false = [
        lane.act(Slot(step, 0, step), [Packet("s1", step, step, "measurement", z)], ledger)[0].values
        for step, z in enumerate(innovations)
    ]
    return np.array(false), ledger


def test_by_default_it_turns_the_sign_and_adds_no_noise() -> None:
    innovations = np.array([[1.0, -2.0], [0.5, 0.25]])
    false, ledger = falsified(attack(), innovations)
    np.testing.assert_array_equal(false, -innovations)
    assert [event.magnitude for event in ledger.events] == pytest.approx(
        [2 * np.sqrt(5.0), np.sqrt(1.0 + 0.25)]
    )


@pytest.mark.parametrize("T", [-0.5, 0.0, [[0.2, 0.1], [-0.3, 0.4]]])
def test_what_arrives_has_the_law_of_innovations_and_the_correlation_that_was_asked_for(T: Any) -> None:
    draws = 4000
    factor = np.linalg.cholesky(S)
    innovations = np.random.default_rng(0).standard_normal((draws, 2)) @ factor.T
    false, _ = falsified(attack(T=T), innovations)
    white = np.linalg.solve(factor, false.T)
    low, high = chi2.interval(1.0 - FALSE_ALARM, df=2 * draws)
    assert low < np.sum(white**2) < high
    matrix = np.asarray(T) * np.eye(2) if np.ndim(T) == 0 else np.array(T)
    added = false - innovations @ matrix.T
    covariance = S - matrix @ S @ matrix.T
    white = np.linalg.solve(np.linalg.cholesky(covariance), added.T)
    assert low < np.sum(white**2) < high


def test_its_noise_is_addressed_by_the_step() -> None:
    innovations = np.zeros((6, 2))
    false, _ = falsified(attack(T=0.0), innovations)
    lane, late = attack(T=0.0).lane("s1->e1"), Packet("s1", 4, 4, "measurement", np.zeros(2))
    assert lane.act(Slot(4, 0, 4), [late], Ledger())[0].values.tolist() == false[4].tolist()


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"T": -1.1}, "T must not enlarge the innovations; try a smaller T"),
        ({"T": [[1.0]]}, r"T has the shape \(1, 1\), and the innovations 2 components"),
        ({"link": "s1->e9"}, "e9 is no estimator that listens to a sensor; attack a link s1->e1"),
    ],
)
def test_parameters_that_make_no_sense_are_refused(parameters: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        attack(**parameters)


def test_a_payload_that_is_no_innovation_of_the_filter_names_the_link() -> None:
    with pytest.raises(ValueError, match="an innovation on s1->e1 has 3 values, not 2"):
        falsified(attack(), np.zeros((1, 3)))
