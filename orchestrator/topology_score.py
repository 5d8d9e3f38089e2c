"""The score of a topology's run, held against what the topology expects: the one way from a record to it."""

from __future__ import annotations

from collections.abc import Mapping

from orchestrator.score.gather import Gathered
from orchestrator.score.results import Score
from orchestrator.score.scoring import Evidence, score_gathered
from orchestrator.topology.resolved import Topology


def score_topology(
    topology: Topology, gathered: Gathered, departed: Mapping[str, int] | None = None
) -> tuple[Score, Evidence]:
    """Return the score of what was gathered of a run, and what it was computed from.

    ``departed`` are the first silent steps of nodes that died and that the others outlived.
    """
    return score_gathered(
        topology.plan,
        gathered,
        state_groups=topology.state_groups,
        options=topology.score_options,
        expectations=topology.expectations,
        departed=departed,
    )
