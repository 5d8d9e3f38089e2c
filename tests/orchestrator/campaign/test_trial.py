"""A trial without log and messages of inboxes is scored as the log of a run is, to the last bit."""

from __future__ import annotations

from pathlib import Path

import pytest

from bus.messages import Message
from orchestrator.backends.inprocess import run_messages
from orchestrator.campaign.trial import run_trial
from orchestrator.evidence.rows import trial_rows
from orchestrator.evidence.table import schema, table
from orchestrator.topology.experiment import topology_from_experiment
from orchestrator.topology.load import load_topology
from tests.orchestrator.campaign.conftest import ROOT
from tests.playing import RING
from tests.system.conftest import PLUGIN

TOPOLOGIES = (
    *(f"adversary/{name}" for name in ("babbling", "corrupt", "delay", "duplicate", "injection", "replay")),
    *(f"adversary/{name}" for name in ("sybil", "signal_attack", "watermark")),
    *("ding2021/lockout", "forti2019/ieee14_injection", "sadeghzadeh2022/attacked"),
)


@pytest.mark.parametrize("name", TOPOLOGIES)
def test_a_trial_gives_the_rows_of_its_record(name: str) -> None:
    topology = load_topology(ROOT / "topologies" / f"{name}.yaml")
    logged = topology_from_experiment(topology.experiment_json())
    records: list[tuple[str, Message]] = []
    run_messages(topology.plan, lambda topic, message: records.append((topic, message)))
    columns = schema(logged.state_groups)
    rows, timing = run_trial(topology.plan, logged, topology.plan.trial)
    assert table(rows, columns).equals(table(trial_rows(logged, records), columns))
    assert 0.0 < timing.step_p50_s <= timing.step_p95_s <= timing.wall_s


def test_a_trial_whose_estimator_publishes_a_field_of_another_type_fails_with_its_name(
    tmp_path: Path,
) -> None:
    ring = RING.format(name="swapped", seed=1, steps=30)
    file = tmp_path / "swapped.yaml"
    file.write_text(
        ring + f"  lone: {{method: '{PLUGIN}:Misbehaving', sensors: [s1], fault: swap, at: 20}}\n"
    )
    topology = load_topology(file)
    ((row,), _) = run_trial(topology.plan, topology_from_experiment(topology.experiment_json()), 0)
    assert row["status"] == "failed"
    assert "lone failed in step 20: TypeError: detections[0].source must be text" in str(row["message"])
