"""The bound of nonlinear plants: the linear one where they are linear, and what a good filter meets."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nodes.gaussian import Gaussian
from nodes.plants.quadruple_tank import QuadrupleTank
from nodes.sensors.tank_outflow import TankOutflow
from orchestrator.backends.inprocess import run_messages
from orchestrator.evidence.bound import information, posterior_bound
from orchestrator.evidence.models import UnsuitedError
from orchestrator.evidence.nonlinear_bound import (
    derivatives,
    expectations,
    nonlinear_posterior_bound,
)
from orchestrator.evidence.rows import trial_rows
from orchestrator.topology.experiment import topology_from_experiment
from orchestrator.topology.load import load_topology

TANKS = """
steps: 40
period_s: 1.0
plant: {model: quadruple_tank, process_noise: {std: 0.03}, initial: {std: 0.1}}
sensors:
  s1: {model: tank_outflow, tanks: [1, 2], noise: {std: 0.3}}
  s2: {model: linear, C: [[0.0, 0.0, 1.0, 0.0]], noise: {std: 0.05}}
estimators:
  e1: {method: extended_kalman, sensors: [s1, s2]}
channel:
  s*->e*: {bernoulli: {loss: 0.3}}
"""


def test_for_a_linear_plant_it_is_the_linear_bound() -> None:
    rng = np.random.default_rng(1)
    A, C, R = np.array([[1.0, 0.1], [-0.2, 0.95]]), np.array([[1.0, 0.5]]), np.array([[0.2]])
    Q, P0 = np.array([[0.02, 0.005], [0.005, 0.03]]), np.diag([1.0, 2.0])
    arrived = rng.random((3, 50, 1)) < 0.6
    expected = expectations(lambda x: x @ A.T, Q, P0, [(lambda x: x @ C.T, R)], rng.normal(size=(200, 50, 2)))
    linear = posterior_bound(A, Q, P0, information(C, R)[None], arrived)
    assert nonlinear_posterior_bound(expected, arrived) == pytest.approx(linear, rel=1e-8)


def test_derivatives_are_those_of_plant_and_sensor() -> None:
    plant = QuadrupleTank(1.0)
    sensor = TankOutflow(plant, tanks=[1, 4], noise=Gaussian(std=1.0))
    states = plant.equilibrium + np.random.default_rng(2).normal(size=(5, 4)) * 0.3
    for function, model in ((plant.transition, plant), (sensor.measure, sensor)):
        found = derivatives(function, states)
        for own, state in zip(found, states, strict=True):
            assert own == pytest.approx(model.jacobian(state), rel=1e-6, abs=1e-7)


def test_expectations_that_do_not_settle_are_refused() -> None:
    draws = np.random.default_rng(3).standard_cauchy((1000, 2, 1))
    with pytest.raises(UnsuitedError, match="do not settle"):
        expectations(lambda x: x**2, np.eye(1), np.eye(1), [(lambda x: x, np.eye(1))], draws)
    with pytest.raises(UnsuitedError, match="singular"):
        expectations(lambda x: x, np.zeros((1, 1)), np.eye(1), [], draws)


def rows(directory: Path, *overrides: str, trial: int = 0) -> dict[str, Any]:
    file = directory / "tanks.yaml"
    file.write_text(TANKS)
    topology = load_topology(file, overrides, trial=trial)
    records: list[Any] = []
    run_messages(topology.plan, lambda topic, message: records.append((topic, message)))
    (row,) = trial_rows(topology_from_experiment(topology.experiment_json()), records)
    return row


def test_a_good_filter_comes_close_to_the_bound_and_does_not_beat_it(tmp_path: Path) -> None:
    """The tanks are nearly linear: mean squares agree within five standard errors of 40 trials."""
    squares = np.array(
        [
            (np.mean(row["error.state"] ** 2), np.mean(row["pcrb.state"] ** 2))
            for row in (rows(tmp_path, trial=trial) for trial in range(40))
        ]
    )
    excess = squares[:, 0] - squares[:, 1]
    assert abs(excess.mean()) < 5.0 * excess.std(ddof=1) / np.sqrt(40)
    assert excess.std(ddof=1) / np.sqrt(40) < 0.2 * squares[:, 1].mean()  # the test could tell


@pytest.mark.parametrize(
    ("override", "reason"),
    [
        (
            "sensors.s2={model: student_t, C: [[1, 0, 0, 0]], scale: 0.1, degrees_of_freedom: 3}",
            "not Gaussian",
        ),
        ("plant.process_noise.std=[0.1, 0.1, 0.1, 0.0]", "singular"),
        ("plant.initial.std=3.0", "run empty"),
    ],
)
def test_it_is_refused_where_it_would_be_wrong(tmp_path: Path, override: str, reason: str) -> None:
    row = rows(tmp_path, override)
    assert reason in row["pcrb.refused"]
    assert np.isnan(row["pcrb.state"]).all()
