"""The score of a log, from nothing but the log."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from orchestrator.log.reader import read_log
from orchestrator.log.recorder import departures
from orchestrator.score.results import Score
from orchestrator.score.scoring import score
from orchestrator.topology.experiment import topology_from_experiment


def score_of_log(path: Path, departed: Mapping[str, int] | None = None) -> Score:
    """Return the score of a log, whole or cut off; raises `LogError` for anything else.

    ``departed`` are the first silent steps of nodes that died, of a log that does not tell of its end yet.
    """
    log = read_log(path, check=False)
    experiment = topology_from_experiment(log.topology_json)
    return score(
        experiment.plan,
        log.records(),
        state_groups=experiment.state_groups,
        options=experiment.score_options,
        expectations=experiment.expectations,
        departed=departures(log.outcome) if departed is None else departed,
    )
