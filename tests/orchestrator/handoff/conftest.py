"""One attacked run of a small network, and a campaign of it whose second variant fails."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from orchestrator.run import run_topology
from orchestrator.topology.load import load_topology
from tests.orchestrator.evidence.conftest import SMALL
from tests.orchestrator.log.conftest import log_path, plan, ring, traffic
from tests.orchestrator.testing.conftest import RAISING

__all__ = ["campaign", "home", "log_path", "plan", "ring", "traffic"]

ROOT = Path(__file__).parents[3]
METHODS = "estimators.lone.method=kalman,./raising.py:Raising"
SWEEP = f"sweep small.yaml --trials 3 -j 1 --set {METHODS} --out campaign"


@pytest.fixture(scope="session")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the topology, and a run of it in ``run``."""
    home = tmp_path_factory.mktemp("handoff")
    (home / "small.yaml").write_text(SMALL)
    (home / "raising.py").write_text(RAISING)
    (home / "run").mkdir()
    run_topology(load_topology(home / "small.yaml"), home / "run", "inprocess", lambda recorded: None)
    return home


@pytest.fixture(scope="session")
def campaign(home: Path) -> Path:
    """The folder of a campaign of two variants and three trials."""
    done = subprocess.run(
        [sys.executable, "-m", "orchestrator.command_line.app", *SWEEP.split()],
        cwd=home,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert (home / "campaign" / "results.parquet").exists(), done.stderr
    return home / "campaign"
