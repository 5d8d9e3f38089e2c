"""The score of a log, from nothing but the log."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from orchestrator.log.reader import read_log
from orchestrator.score.gather import gather
from orchestrator.score.results import Score
from orchestrator.topology.experiment import topology_from_experiment
from orchestrator.topology_score import score_topology


def score_of_log(path: Path, departed: Mapping[str, int] | None = None) -> Score:
    """Return the score of a log, whole or cut off; raises `LogError` for anything else.

    ``departed`` are the first silent steps of nodes that died, of a log that does not tell of its end yet.
    """
    log = read_log(path, check=False)
    topology = topology_from_experiment(log.topology_json)
    gathered = gather(topology.plan, log.records())
    return score_topology(topology, gathered, log.departed if departed is None else departed)[0]
