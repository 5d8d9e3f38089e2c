"""The topologies of the distributed filters: each keeps what it expects of its run."""

from __future__ import annotations

from pathlib import Path

import pytest

from orchestrator.score.results import Score
from orchestrator.topology.load import load_topology
from tests.playing import assert_keeps_what_it_expects, scored

FOLDER = Path(__file__).parents[2] / "topologies" / "distributed"
ALONE = ("kalman_consensus", "information_consensus", "diffusion_kalman", "covariance_intersection")


def played(stem: str) -> Score:
    return scored(load_topology(FOLDER / f"{stem}.yaml"))


@pytest.mark.parametrize("stem", ALONE)
def test_each_method_keeps_what_its_topology_promises(stem: str) -> None:
    found = played(stem)
    assert_keeps_what_it_expects(found)


@pytest.mark.slow
@pytest.mark.parametrize("stem", ["comparison", "comparison_loss"])
def test_the_comparison_keeps_what_it_promises(stem: str) -> None:
    found = played(stem)
    assert_keeps_what_it_expects(found)


def test_every_topology_of_the_folder_is_run_here() -> None:
    files = {path.stem for path in FOLDER.glob("[a-z]*.yaml")}
    assert files == {*ALONE, "comparison", "comparison_loss"}
