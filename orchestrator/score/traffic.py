"""What the channel did to the packets, as it counted them itself."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orchestrator.score.gather import Gathered, Ints
from orchestrator.score.results import Traffic


def _loss_bursts(gathered: Gathered) -> Ints:
    """Return by link (L,) the number of runs of consecutive sequence numbers that the stages lost."""
    lost = ~gathered.events.mark
    rows = np.stack([gathered.events.link[lost], gathered.events.sequence[lost]])
    link, sequence = np.unique(rows, axis=1)
    begins = np.ones(link.size, dtype=bool)
    begins[1:] = (np.diff(link) != 0) | (np.diff(sequence) > 1)
    return np.bincount(link[begins], minlength=gathered.counts.shape[1])


def traffic(gathered: Gathered) -> tuple[list[Traffic], Traffic]:
    """Return the packets of each link, and of all."""
    table = np.vstack([gathered.counts, _loss_bursts(gathered)])
    return [_named(column) for column in table.T.tolist()], _named(table.sum(axis=1).tolist())


def _named(counts: Sequence[int]) -> Traffic:
    return Traffic.of(**dict(zip(Traffic.COUNTS, counts, strict=True)))
