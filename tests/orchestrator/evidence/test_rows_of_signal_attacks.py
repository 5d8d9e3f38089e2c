"""What rows and reports hold of a signal attack, beside the score's own figures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bus.messages import Truth
from orchestrator.backends.inprocess import run_messages
from orchestrator.evidence.rows import trial_rows
from orchestrator.evidence.table import schema, table
from orchestrator.report.recording import read_recording
from orchestrator.report.signals import signal_figure
from orchestrator.run import run_topology
from orchestrator.run_directory import LOG
from orchestrator.topology.load import load_topology
from orchestrator.topology.resolved import Topology

FOLDER = Path(__file__).parents[3] / "topologies"
ATTACKED = slice(50, 100)


def network(form: str, *overrides: str) -> Topology:
    """A hundred steps of a power network, of which the second half is attacked."""
    return load_topology(
        FOLDER / "forti2019" / f"{form}.yaml", ["expect=null", "score.from_step=0", *overrides]
    )


@pytest.mark.parametrize("form", ["ieee14_injection", "ieee14_no_feedthrough"])
def test_probability_and_error_stand_at_the_step_that_they_are_about(form):
    topology = network(form)
    records = []
    run_messages(topology.plan, lambda topic, message: records.append((topic, message)))
    (row,) = trial_rows(topology, records)
    probability, error = row["attack_probability"], row["attack_error"]
    assert probability.shape == error.shape == (topology.plan.steps,)
    on = ~np.isnan(error)
    np.testing.assert_array_equal(row["attack_on"][on], True)
    assert row["attack_on"].sum() == 50
    assert np.mean(probability[on]) > 0.9
    assert np.nanmean(probability[~on]) < 0.2
    assert np.nanmean(probability[on]) == pytest.approx(row["attack.probability_on"])
    assert np.nanmean(probability[~on]) == pytest.approx(row["attack.probability_off"])
    assert np.sqrt(np.mean(error[on] ** 2)) == pytest.approx(row["attack.rmse"])


def test_where_the_truth_is_missing_nobody_says_whether_there_was_an_attack():
    topology = network("ieee14_injection")
    records = []
    run_messages(topology.plan, lambda topic, message: records.append((topic, message)))
    (row,) = trial_rows(
        topology, [(topic, m) for topic, m in records if not (isinstance(m, Truth) and m.step in (3, 55))]
    )
    held = table([row], schema(topology.state_groups))["attack_on"].to_pylist()[0]
    assert [step for step, on in enumerate(held) if on is None] == [3, 55]
    assert [step for step, on in enumerate(held) if on] == [*range(50, 55), *range(56, 100)]


def test_the_report_of_a_run_draws_probability_and_signal_beside_the_truth(tmp_path: Path):
    topology = network("ieee14_injection")
    run_topology(topology, tmp_path, "inprocess", lambda recorded: None)
    recording = read_recording(tmp_path / LOG)
    figure = signal_figure(recording)
    assert figure is not None
    probability, truth, told, *_ = figure.views["e1",].traces
    assert np.mean(probability["y"][ATTACKED]) > 0.8 > 0.3 > np.mean(probability["y"][:50])
    np.testing.assert_allclose(truth["y"][ATTACKED], 0.2)
    assert np.isnan(truth["y"][:50]).all()
    assert np.nanmean(np.abs(told["y"][ATTACKED] - 0.2)) < 0.1
