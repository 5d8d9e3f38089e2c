"""Rates over trials, and what may be said where all trials are alike, of which resampling knows nothing.

From trials that are all alike every bootstrap sample is the same, and its interval has no width, as if the
figure were certain. What they do show: one trial tells what the T - 1 others repeat, and were the share of
trials that differ larger than ``1 - alpha^(1 / (T - 1))``, all would repeat it with a probability below
``alpha``. So with confidence ``1 - alpha`` no larger share differs, about ``3 / T`` at 95 % (the rule of
three: Hanley and Lippman-Hand 1983, JAMA 249:1743). What these are like is not known, so each may be
anything: packets of one trial are not independent, since a detector that locks itself out rejects all the
rest of them.
"""

from __future__ import annotations

import numpy as np

from orchestrator.evidence.bootstrap import CONFIDENCE, Band, bootstrap, pooled
from orchestrator.score.gather import Floats, Ints


def unseen_share(trials: Ints, confidence: float = CONFIDENCE) -> Floats:
    """Return the largest share (K,) of trials that may differ where ``trials`` (K,) of them are all alike.

    It is 1 for one trial or none.
    """
    others = np.maximum(np.asarray(trials, dtype=np.float64) - 1.0, 0.0)
    with np.errstate(divide="ignore"):
        share: Floats = 1.0 - (1.0 - confidence) ** (1.0 / others)
    return share


def with_unseen(band: Band, trials: Ints, confidence: float = CONFIDENCE) -> Band:
    """Return the band of a figure between 0 and 1 (K,), with a width where all trials are alike.

    ``trials`` (K,) is the number of trials that tell of each point.
    """
    alike = band.low == band.high
    share = unseen_share(trials, confidence)
    low = (1.0 - share) * band.value
    return Band(band.value, np.where(alike, low, band.low), np.where(alike, low + share, band.high))


def pooled_rate(events: Floats, chances: Floats, confidence: float = CONFIDENCE) -> Band:
    """Return the rate of events among chances (N, K) over N trials, and its interval at each of K points.

    A trial without any chance tells nothing; the others are supposed to have about as many each.
    """
    band = bootstrap(pooled(events, chances), len(events), confidence=confidence)
    return with_unseen(band, np.sum(chances > 0.0, axis=0), confidence)
