"""What the channel did to the packets, as it counted them itself."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bus.plan import Plan
from orchestrator.score.gather import Gathered, Ints
from orchestrator.score.link_results import SenderScore, Traffic


def _loss_bursts(gathered: Gathered) -> Ints:
    """Return by link (L,) the number of runs of consecutive sequence numbers that the stages lost."""
    lost = ~gathered.events.mark
    link, sequence = gathered.events.link[lost], gathered.events.sequence[lost]
    order = np.lexsort((sequence, link))
    link, sequence = link[order], sequence[order]
    begins = np.ones(link.size, dtype=bool)
    begins[1:] = (np.diff(link) != 0) | (np.diff(sequence) > 1)
    return np.bincount(link[begins], minlength=gathered.counts.shape[1])


def traffic(gathered: Gathered) -> tuple[list[Traffic], Traffic]:
    """Return the packets of each link, and of all."""
    table = np.vstack([gathered.counts, _loss_bursts(gathered)])
    return [_named(column) for column in table.T.tolist()], _named(table.sum(axis=1).tolist())


def senders(plan: Plan, gathered: Gathered) -> list[SenderScore]:
    """Return how much each node with an event trigger sent, as told by the first link that leaves it.

    A node's slots end where the topology lets it fall silent.
    """
    first: dict[str, int] = {}
    for number, link in enumerate(plan.links):
        first.setdefault(link.source, number)
    rounds = {estimator.name: estimator.rounds for estimator in plan.estimators}
    found = []
    for name in plan.triggered:
        slots, sent = gathered.said_sent.get(name, (0, 0.0))
        if not slots and name in first:
            owed = plan.silent_from(name) * rounds.get(name, 1)
            slots = min(int(gathered.slots[first[name]]), owed)
            sent = float(gathered.counts[0, first[name]])
        found.append(SenderScore.of(name, slots, sent))
    return found


def _named(counts: Sequence[int]) -> Traffic:
    return Traffic.of(**dict(zip(Traffic.COUNTS, counts, strict=True)))
