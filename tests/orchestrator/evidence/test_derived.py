"""The bound and the innovations of runs: right where they stand, refused where they would be wrong."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from orchestrator.backends.inprocess import run_messages
from orchestrator.evidence.rows import trial_rows
from orchestrator.topology.experiment import topology_from_experiment
from orchestrator.topology.load import load_topology

ALONE = """
steps: 30
period_s: 0.1
plant: {model: constant_acceleration, process_noise: {std: 0.2}, initial: {std: 1.0}}
sensors:
  s1: {model: linear, C: [[1.0, 0.0, 0.0]], noise: {std: 0.1}}
  s2: {model: linear, C: [[0.0, 1.0, 0.3]], noise: {std: 0.4}}
estimators:
  e1: {method: kalman, sensors: [s1, s2]}
channel:
  s*->e*: {gilbert_elliott: {failure: 0.3, recovery: 0.4}}
"""
NETWORK = """
steps: 20
period_s: 0.1
plant: {model: constant_acceleration, process_noise: {std: 0.2}, initial: {std: 1.0}}
graph: {ring: {nodes: 3}}
sensors:
  s1..s3: {model: linear, C: [[1.0, 0.0, 0.0]], noise: {std: 0.1}}
estimators:
  e1..e3: {method: secure_distributed, coupling: 0.01}
  hub: {method: kalman_centralized, sensors: [s1, s2, s3]}
"""


def rows(directory: Path, text: str, *overrides: str, trial: int = 0) -> dict[str, dict[str, Any]]:
    """Return the rows of a run by node."""
    file = directory / "run.yaml"
    file.write_text(text)
    topology = load_topology(file, overrides, trial=trial)
    records: list[Any] = []
    run_messages(topology.plan, lambda topic, message: records.append((topic, message)))
    logged = topology_from_experiment(topology.experiment_json())
    return {row["node"]: row for row in trial_rows(logged, records)}


def estimates(directory: Path, text: str) -> tuple[np.ndarray, np.ndarray]:
    """Return covariances (K, n, n) and NIS (K,) that the first estimator published."""
    topology = load_topology(directory / "run.yaml")
    found: list[Any] = []
    run_messages(topology.plan, lambda topic, message: found.append((topic, message)))
    own = [message for topic, message in found if topic == "estimate/e1"]
    return np.array([m.covariance for m in own]).reshape(-1, 3, 3), np.array([m.nis for m in own])


def test_the_bound_of_a_run_is_the_covariance_of_the_optimal_filter_in_it(tmp_path: Path) -> None:
    row = rows(tmp_path, ALONE)["e1"]
    covariance, _ = estimates(tmp_path, ALONE)
    trace = np.trace(covariance, axis1=1, axis2=2)
    assert row["pcrb.state"] == pytest.approx(np.sqrt(trace), rel=1e-10)
    assert row["pcrb.position"] == pytest.approx(np.sqrt(covariance[:, 0, 0]), rel=1e-10)
    assert (row["pcrb.given"], row["pcrb.refused"]) == ("own packets", "")


def test_the_innovations_of_the_record_have_the_nis_that_the_filter_published(tmp_path: Path) -> None:
    row = rows(tmp_path, ALONE)["e1"]
    _, nis = estimates(tmp_path, ALONE)
    own = np.nansum(row["innovation"].reshape(30, 2) ** 2, axis=1)
    assert own[1:] == pytest.approx(nis[1:], rel=1e-8)
    assert np.isnan(row["innovation"][:2]).all()  # nothing was believed before step 0


def test_a_network_is_bounded_by_all_that_reached_it(tmp_path: Path) -> None:
    found = rows(tmp_path, NETWORK)
    assert found["e1"]["pcrb.given"] == "packets of the network"
    assert found["hub"]["pcrb.given"] == "own packets"
    # nothing is lost here, so the network together has what the centralised filter has
    assert found["e1"]["pcrb.state"] == pytest.approx(found["hub"]["pcrb.state"], rel=1e-12)


@pytest.mark.parametrize(
    ("override", "first", "reason"),
    [
        ("attacks=[{bias: {value: 1.0}, on: s1->e1, steps: [12, 15]}]", 12, "not as its sensor had sent it"),
        (
            "attacks=[{injection: {values: {box: {low: -9.0, high: 9.0}}}, on: s2->e1, steps: [9, 9]}]",
            9,
            "not as its sensor",
        ),
        ("channel={'s*->e*': {delay: {delay: 1}}}", 1, "later than the step"),
        ("channel={'s*->e*': {quantise: {step: 0.5}}}", 0, "not as its sensor"),
        ("channel={'s*->e*': {rate: {rate: 3}}}", 0, "acts on what it sees"),
        (
            "sensors.s1={model: student_t, C: [[1.0, 0.0, 0.0]], scale: 0.1, degrees_of_freedom: 3}",
            0,
            "Gaussian",
        ),
    ],
)
def test_the_bound_is_refused_from_where_it_would_be_wrong(
    tmp_path: Path, override: str, first: int, reason: str
) -> None:
    row = rows(tmp_path, ALONE, override)["e1"]
    assert np.isfinite(row["pcrb.state"][:first]).all()
    assert np.isnan(row["pcrb.state"][first:]).all()
    assert reason in row["pcrb.refused"]
    assert row["pcrb.refused"].startswith(f"from step {first} on: ") == (first > 0)


def test_nothing_is_supposed_of_a_users_own_kind(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text("from nodes.sensors.linear import Linear\nclass Mine(Linear): ...\n")
    mine = f"sensors.s1={{model: '{tmp_path}/mine.py:Mine', C: [[1.0, 0.0, 0.0]], noise: {{std: 0.1}}}}"
    row = rows(tmp_path, ALONE, mine)["e1"]
    assert row["pcrb.refused"] == "the kind Mine is a user's own, of which nothing is known here"
    assert not row["innovation"].size


def test_a_sensor_that_keeps_quiet_tells_something_too(tmp_path: Path) -> None:
    """A record in which a sensor sent nothing in step 7, as an event trigger would have it."""
    file = tmp_path / "run.yaml"
    file.write_text(ALONE)
    topology = load_topology(file)
    records: list[Any] = []
    run_messages(topology.plan, lambda topic, message: records.append((topic, message)))
    quiet = [
        (topic, message)
        for topic, message in records
        if not (message.step == 7 and topic in ("tx/s2/measurement", "rx/e1/correct"))
    ]
    (row,) = trial_rows(topology_from_experiment(topology.experiment_json()), quiet)
    assert row["pcrb.refused"] == "from step 7 on: s2 kept quiet, which tells something too"


def test_one_falsified_packet_costs_the_whole_network_its_bound(tmp_path: Path) -> None:
    attack = "attacks=[{bias: {value: 1.0}, on: s2->e2, steps: [5, 5]}]"
    found = rows(tmp_path, NETWORK, attack)
    assert all(np.isnan(found[node]["pcrb.state"][5:]).all() for node in ("e1", "e2", "e3"))
    assert found["hub"]["pcrb.refused"] == ""  # that one heard the sensor's other link


@pytest.mark.slow
def test_no_filter_beats_the_bound_and_the_optimal_one_meets_it(tmp_path: Path) -> None:
    """Over 400 trials the ratio of mean squares is one within 5 standard errors."""
    squares = [
        (np.mean(row["error.state"] ** 2), np.mean(row["pcrb.state"] ** 2))
        for row in (rows(tmp_path, ALONE, trial=trial)["e1"] for trial in range(400))
    ]
    error, bound = np.array(squares).T
    excess = error - bound
    assert abs(excess.mean()) < 5.0 * excess.std() / np.sqrt(400)
