"""Attacks that know the model: that detectors do not see them here, and what they do, beside the theory.

Whole runs of the topologies of ``topologies/adversary``. An attacked run and one without the attack meet the
same noises, so that their difference is the attack's work alone. The quick figures come from few trials;
``-m slow`` takes more, and ``-s`` prints them beside the theory. The docs quote them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are, solve_discrete_lyapunov
from scipy.stats import binom, chi2, ncx2

from bus.messages import Estimate, Truth
from bus.plan import Plan
from channel.invariant_zeros import invariant_zeros
from nodes.build import build_controller, build_plant, build_sensor
from nodes.contract import LinearSensor
from nodes.controllers.state_feedback import StateFeedback
from nodes.plants.linear import Linear
from orchestrator.topology.load import load_topology
from orchestrator.topology.resolved import Topology
from tests.papers.campaigns import quick_or_full
from tests.playing import assert_keeps_what_it_expects, record_of, scored

FOLDER = Path(__file__).parents[2] / "topologies" / "adversary"
FILES = [path.stem for path in sorted(FOLDER.glob("*.yaml")) if not path.stem.startswith("_")]
FALSE_ALARM = 1e-6
THRESHOLD = 6.63
QUICK, FULL = 4, 100

pytestmark = pytest.mark.timeout(600)

trials = quick_or_full(QUICK, FULL)


@dataclass(frozen=True)
class Run:
    """What one run came to: states (steps, n), and by estimator its estimates and statistics."""

    truth: np.ndarray
    estimates: dict[str, np.ndarray]
    statistics: dict[str, np.ndarray]
    """(steps, packets)"""

    def error(self, node: str = "e1") -> np.ndarray:
        return self.estimates[node] - self.truth

    def alarms(self, first: int, last: int, node: str = "e1") -> int:
        """Return the alarms of the detector in the steps from first to last."""
        return int(np.sum(self.statistics[node][first : last + 1] >= THRESHOLD))


@lru_cache(maxsize=32)
def loaded(name: str, *overrides: str) -> Topology:
    return load_topology(FOLDER / f"{name}.yaml", [*overrides, "expect=null"])


@lru_cache(maxsize=8 * FULL)
def play(name: str, trial: int, *overrides: str) -> Run:
    topology = loaded(name, *overrides).at(trial=trial)
    plan, messages = topology.plan, record_of(topology)
    truth = np.array([message.state for _, message in messages if isinstance(message, Truth)])
    told: dict[str, list[Estimate]] = {own.name: [] for own in plan.estimators}
    for topic, message in messages:
        if isinstance(message, Estimate):
            told[topic.split("/")[1]].append(message)
    return Run(
        truth,
        {node: np.array([own.state for own in row]) for node, row in told.items()},
        {node: np.array([own.detector_statistic for own in row]) for node, row in told.items()},
    )


@dataclass(frozen=True)
class Model:
    """The matrices of a plant, of its sensors together, and of the settled filter on them."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    K: np.ndarray
    S: np.ndarray
    P: np.ndarray
    """Error covariance of the corrected estimate."""


def model_of(plan: Plan, *names: str) -> Model:
    plant = build_plant(plan)
    assert isinstance(plant, Linear)
    sensors = [build_sensor(plan, name, plant) for name in names]
    assert all(isinstance(sensor, LinearSensor) for sensor in sensors)
    C = np.concatenate([sensor.C for sensor in sensors])  # type: ignore[attr-defined]
    R = np.diag(np.concatenate([np.diag(sensor.R) for sensor in sensors]))  # type: ignore[attr-defined]
    prior = solve_discrete_are(plant.A.T, C.T, plant.Q, R)
    S = C @ prior @ C.T + R
    K = prior @ C.T @ np.linalg.inv(S)
    return Model(plant.A, plant.B, C, K, S, prior - K @ C @ prior)


def assert_rate(alarms: int, packets: int, rate: float) -> None:
    """Hold a number of independent verdicts against a rate; wrong once in a million."""
    low, high = binom.interval(1.0 - FALSE_ALARM, packets, rate)
    assert low <= alarms <= high, f"{alarms} alarms on {packets} packets, for a rate of {rate:.4f}"


def clopper_pearson(alarms: int, packets: int, level: float = 0.95) -> str:
    from scipy.stats import binomtest

    interval = binomtest(alarms, packets).proportion_ci(level, "exact")
    return f"{alarms / packets:.4f} [{interval.low:.4f}, {interval.high:.4f}]"


QUIET = float(chi2.sf(THRESHOLD, 1))
NO_ATTACK = ("attacks=null",)


@pytest.mark.parametrize("name", FILES)
def test_the_file_holds_what_it_expects(name: str) -> None:
    assert_keeps_what_it_expects(scored(load_topology(FOLDER / f"{name}.yaml")))


# Zero dynamics --------------------------------------------------------------------------------------------

FIRST, LAST = 200, 299
EPS = 0.02


def zero_dynamics_theory(model: Model, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Return how much error (steps, n) and innovation (steps, m) change, from the first attacked step on.

    The error moves by eps z^j x0, but for the response f of the filter's error to a start at -eps x0.
    """
    zero = invariant_zeros(model.A, model.B, model.C)[0]
    z, x = zero.z.real, np.real(zero.x)
    motion = (np.eye(len(x)) - model.K @ model.C) @ model.A
    response, errors, innovations = -EPS * x, [], []
    for since in range(steps):
        errors.append(-(EPS * z**since * x + response))
        innovations.append(model.C @ model.A @ response)
        response = motion @ response
    return np.array(errors), np.array([np.zeros(len(model.C)), *innovations[:-1]])


def test_zero_dynamics_the_error_grows_along_the_zero_to_rounding() -> None:
    model = model_of(loaded("zero_dynamics").plan, "s1", "s2")
    attacked, quiet = play("zero_dynamics", 0), play("zero_dynamics", 0, *NO_ATTACK)
    moved = (attacked.error() - quiet.error())[FIRST:]
    expected, _ = zero_dynamics_theory(model, LAST - FIRST + 1)
    np.testing.assert_allclose(moved, expected, rtol=1e-6, atol=1e-9)
    assert np.linalg.norm(moved[-1]) > 10.0


@trials
def test_zero_dynamics_the_alarm_rate_stays_what_it_is_without(trials: int) -> None:
    """The noncentrality of a step is at most 0.04; alarms are independent over steps and outputs."""
    model = model_of(loaded("zero_dynamics").plan, "s1", "s2")
    _, innovations = zero_dynamics_theory(model, LAST - FIRST + 1)
    noncentrality = innovations**2 / np.diag(model.S)
    assert noncentrality.max() < 0.04
    rate = float(np.mean(ncx2.sf(THRESHOLD, 1, np.maximum(noncentrality, 1e-12))))
    runs = [(play("zero_dynamics", k), play("zero_dynamics", k, *NO_ATTACK)) for k in range(trials)]
    packets = trials * 2 * (LAST - FIRST + 1)
    attacked = sum(one.alarms(FIRST, LAST) for one, _ in runs)
    quiet = sum(other.alarms(FIRST, LAST) for _, other in runs)
    rms = np.sqrt(np.mean([np.sum(one.error()[LAST] ** 2) for one, _ in runs]))
    theory = np.sqrt(np.sum(zero_dynamics_theory(model, LAST - FIRST + 1)[0][-1] ** 2) + np.trace(model.P))
    print(
        f"\nzero_dynamics: alarm rate {clopper_pearson(attacked, packets)}, theory {rate:.4f}, without attack"
    )
    print(f"  {clopper_pearson(quiet, packets)}; rms error in the last step {rms:.3f}, theory {theory:.3f}")
    assert_rate(attacked, packets, rate)
    assert_rate(quiet, packets, QUIET)


# Covert ---------------------------------------------------------------------------------------------------


def test_covert_residuals_are_those_of_the_unattacked_run_and_the_plant_is_off_by_the_added_motion() -> None:
    plan = loaded("covert").plan
    plant = build_plant(plan)
    assert isinstance(plant, Linear)
    attacked, quiet = play("covert", 0), play("covert", 0, *NO_ATTACK)
    np.testing.assert_allclose(attacked.statistics["e1"], quiet.statistics["e1"], rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(attacked.estimates["e1"], quiet.estimates["e1"], rtol=1e-9, atol=1e-9)
    motion = [np.zeros(2)]
    for step in range(plan.steps - 1):
        added = 0.1 if 100 <= step <= 250 else 0.0
        motion.append(plant.A @ motion[-1] + plant.B[:, 0] * added)
    np.testing.assert_allclose(attacked.truth - quiet.truth, motion, rtol=1e-9, atol=1e-9)
    difference = np.abs(attacked.statistics["e1"] - quiet.statistics["e1"]).max()
    print(f"\ncovert: statistics differ by at most {difference:.1e}, position by {motion[-1][0]:.2f} m")


# Optimal linear -------------------------------------------------------------------------------------------


def settled_error(model: Model, T: float) -> np.ndarray:
    """Return P + D (n, n) for an attack with T times the identity."""
    spread = 2.0 * (1.0 - T) * model.S
    return model.P + solve_discrete_lyapunov(model.A, model.K @ spread @ model.K.T)


@trials
@pytest.mark.parametrize("T", [-1.0, 0.0, 0.5])
def test_optimal_linear_the_error_grows_as_the_theory_says_and_the_detector_sees_nothing(
    T: float, trials: int
) -> None:
    """Errors in steps that lie 100 apart count as independent: the plant forgets by a factor of 20."""
    overrides = (f"attacks[0].optimal_linear.T={T}",)
    model = model_of(loaded("optimal_linear").plan, "s1")
    theory = settled_error(model, T)
    runs = [play("optimal_linear", k, *overrides) for k in range(trials)]
    alarms = sum(run.alarms(100, 499) for run in runs)
    errors = np.concatenate([run.error()[[299, 399, 499]] for run in runs])
    measured = float(np.mean(np.sum(errors**2, axis=1)))
    print(
        f"\noptimal_linear T = {T}: alarm rate {clopper_pearson(alarms, 400 * trials)}, theory {QUIET:.4f};"
    )
    print(
        f"  mean square error {measured:.3f}, theory {np.trace(theory):.3f}, without {np.trace(model.P):.3f}"
    )
    assert_rate(alarms, 400 * trials, QUIET)
    whitened = np.sum(errors * np.linalg.solve(theory, errors.T).T)
    low, high = chi2.interval(1.0 - FALSE_ALARM, df=errors.size)
    assert low < whitened < high


def test_optimal_linear_with_the_sign_turned_every_statistic_is_what_it_was() -> None:
    attacked, quiet = play("optimal_linear", 0), play("optimal_linear", 0, *NO_ATTACK)
    np.testing.assert_array_equal(attacked.statistics["e1"], quiet.statistics["e1"])


# Worst-case bias ------------------------------------------------------------------------------------------

BUDGET = 0.5


def test_worst_case_bias_the_error_is_off_by_the_predicted_bias_to_rounding() -> None:
    model = model_of(loaded("worst_case_bias").plan, "s1")
    attacked, quiet = play("worst_case_bias", 0), play("worst_case_bias", 0, *NO_ATTACK)
    delta, bias = np.sqrt(BUDGET * model.S[0]), np.zeros(2)
    expected = []
    for _ in range(300):
        bias = model.A @ bias + model.K @ delta
        expected.append(bias)
    moved = (attacked.error() - quiet.error())[100:]
    np.testing.assert_allclose(moved, expected, rtol=1e-6, atol=1e-9)
    print(f"\nworst_case_bias: the position is off by {moved[-1][0]:.2f} m, theory {expected[-1][0]:.2f} m")


@trials
@pytest.mark.parametrize("budget", [0.5, 4.0])
def test_worst_case_bias_the_alarm_rate_is_that_of_the_noncentral_law(budget: float, trials: int) -> None:
    rate = float(ncx2.sf(THRESHOLD, 1, budget))
    runs = [play("worst_case_bias", k, f"attacks[0].worst_case_bias.budget={budget}") for k in range(trials)]
    alarms = sum(run.alarms(100, 399) for run in runs)
    print(
        f"\nworst_case_bias {budget}: alarm rate {clopper_pearson(alarms, 300 * trials)}, theory {rate:.4f}"
    )
    assert_rate(alarms, 300 * trials, rate)
    assert_rate(sum(run.alarms(30, 99) for run in runs), 70 * trials, QUIET)


# Replay, with and without a watermark ---------------------------------------------------------------------

REPLAYED = slice(240, 400)
NO_WATERMARK = ("controllers.c1.watermark=null",)


def replay_rate(std: float) -> float:
    """Return the alarm rate under replay, once the loop has forgotten where it was when it began.

    The prediction differs from the recording's by q+ = F q + B (w - w'), with F = (A - B L) (I - K C) and
    two independent marks, so that an innovation has the covariance S + C U C' with U = F U F' + 2 B W B' (Mo,
    Weerakkody, Sinopoli 2015).
    """
    plan = loaded("closed_loop").plan
    model = model_of(plan, "s1")
    controller = build_controller(plan, plan.controllers[0], build_plant(plan))
    assert isinstance(controller, StateFeedback)
    F = (model.A - model.B @ controller.gain) @ (np.eye(2) - model.K @ model.C)
    U = solve_discrete_lyapunov(F, 2.0 * std**2 * model.B @ model.B.T)
    return float(chi2.sf(THRESHOLD / (1.0 + (model.C @ U @ model.C.T / model.S).item()), 1))


@trials
@pytest.mark.parametrize("std", [0.0, 0.5, 1.0])
def test_replay_is_found_by_a_watermark_and_by_nothing_else_at_the_rate_of_the_theory(
    std: float, trials: int
) -> None:
    """With a mark, alarms of a run are not independent: the runs' rates are, and are held within 6 sigma."""
    overrides = (f"controllers.c1.watermark.std={std}",) if std else NO_WATERMARK
    rates = np.array(
        [
            np.mean(play("watermark", k, *overrides).statistics["e1"][REPLAYED] >= THRESHOLD)
            for k in range(trials)
        ]
    )
    theory, spread = replay_rate(std), float(rates.std(ddof=1) / np.sqrt(trials))
    print(
        f"\nreplay, watermark {std}: alarm rate {rates.mean():.4f} +- {2 * spread:.4f}, theory {theory:.4f}"
    )
    if std:
        # few runs tell little of their own spread
        assert abs(rates.mean() - theory) < 6.0 * max(spread, 0.1 * theory if trials == QUICK else 0.0)
    else:
        assert theory == pytest.approx(QUIET)
        packets = trials * (REPLAYED.stop - REPLAYED.start)
        assert_rate(round(rates.sum() * packets / trials), packets, QUIET)
