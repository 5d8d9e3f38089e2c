"""What an attack costs: each attacked trial beside its twin, the same seed and trial without the attack.

Two topologies are twins when they differ in their attacks alone and one has none. Whatever is drawn, is drawn
alike in both (common random numbers), so the difference of a trial is the work of the attack.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from orchestrator.evidence.bootstrap import CONFIDENCE
from orchestrator.evidence.columns import Rows
from orchestrator.evidence.ranks import Difference, pair, paired_difference
from orchestrator.evidence.samples import sample

_APART = frozenset({"attacks", "expect", "name", "description", "seed", "trial"})


@dataclass(frozen=True)
class Price:
    """The price of an attack in a metric: attacked less unattacked, and over the twin's median.

    ``attacked`` and ``unattacked`` are the medians. ``by_trial`` holds the differences of the common trials.
    """

    difference: Difference
    relative: float
    attacked: float
    unattacked: float
    by_trial: Sequence[float]


def find_twins(documents: Sequence[Mapping[str, Any]]) -> dict[int, int]:
    """Return by the number of each attacked topology that of its unattacked twin, where there is one."""
    unattacked = [i for i, own in enumerate(documents) if not own.get("attacks")]
    twins = {}
    for i, own in enumerate(documents):
        if own.get("attacks"):
            twin = next((j for j in unattacked if _rest(documents[j]) == _rest(own)), None)
            if twin is not None:
                twins[i] = twin
    return twins


def _rest(document: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in document.items() if key not in _APART}


def price(attacked: Rows, twin: Rows, metric: str, confidence: float = CONFIDENCE) -> Price:
    """Return what the attack costs in a metric, over the trials that both have."""
    hit, spared = sample(attacked, metric), sample(twin, metric)
    at_hit, at_spared = pair(hit.keys, spared.keys)
    a, b = hit.values[at_hit], spared.values[at_spared]
    difference = paired_difference(a, b, confidence)
    with np.errstate(invalid="ignore", divide="ignore"):
        by_trial = np.where(a == b, 0.0, a - b)
        middle = [float(np.median(values)) if values.size else np.nan for values in (a, b)]
        relative = difference.shift.value / middle[1] if middle[1] > 0.0 else np.nan
    return Price(difference, relative, middle[0], middle[1], by_trial.tolist())
