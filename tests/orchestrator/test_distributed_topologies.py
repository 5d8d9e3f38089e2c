"""The topologies of the distributed filters: each keeps what it expects of its run."""

from __future__ import annotations

from pathlib import Path

import pytest

from bus.messages import Message
from orchestrator.backends.inprocess import run_messages
from orchestrator.score.results import Score
from orchestrator.score.scoring import score
from orchestrator.topology.load import load_topology

FOLDER = Path(__file__).parents[2] / "topologies" / "distributed"
ALONE = ("kalman_consensus", "information_consensus", "diffusion_kalman", "covariance_intersection")


def played(stem: str) -> Score:
    topology = load_topology(FOLDER / f"{stem}.yaml")
    record: list[tuple[str, Message]] = []
    run_messages(topology.plan, lambda topic, message: record.append((topic, message)))
    return score(
        topology.plan,
        record,
        state_groups=topology.state_groups,
        options=topology.score_options,
        expectations=topology.expectations,
    )


@pytest.mark.parametrize("stem", ALONE)
def test_each_method_keeps_what_its_topology_promises(stem: str) -> None:
    found = played(stem)
    assert found.passed, [outcome.message for outcome in found.expectations if not outcome.passed]


@pytest.mark.slow
@pytest.mark.parametrize("stem", ["comparison", "comparison_loss"])
def test_the_comparison_keeps_what_it_promises(stem: str) -> None:
    found = played(stem)
    assert found.passed, [outcome.message for outcome in found.expectations if not outcome.passed]


def test_every_topology_of_the_folder_is_run_here() -> None:
    files = {path.stem for path in FOLDER.glob("[a-z]*.yaml")}
    assert files == {*ALONE, "comparison", "comparison_loss"}
