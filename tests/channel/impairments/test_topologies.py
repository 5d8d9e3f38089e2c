"""Every impairment has a topology that shows it; its expectations hold at its seed."""

from __future__ import annotations

from pathlib import Path

import pytest

from orchestrator.registry import BUILT_IN
from orchestrator.run import run_topology
from orchestrator.run_directory import make_run_directory
from orchestrator.topology.load import load_topology

FOLDER = Path(__file__).parents[3] / "topologies" / "adversary"
KINDS = sorted(set(BUILT_IN["impairments"]) - {"perfect"})


@pytest.mark.parametrize("kind", KINDS)
def test_the_topology_of_an_impairment_keeps_its_expectations(kind: str, tmp_path: Path) -> None:
    topology = load_topology(FOLDER / f"{kind}.yaml")
    assert {stage.kind.reference for stage in topology.plan.stages} >= {BUILT_IN["impairments"][kind]}
    directory = make_run_directory(tmp_path / kind, topology.plan.name, topology.plan.seed)
    report = run_topology(topology, directory, "inprocess", lambda recorded: None)
    assert report.exit_code == 0, report.message
