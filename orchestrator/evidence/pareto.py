"""Which of several variants nobody beats in communication and error at once."""

from __future__ import annotations

import numpy as np

from orchestrator.score.gather import Bools, Floats


def pareto_front(cost: Floats, error: Floats) -> Bools:
    """Return which points (V,) are on the front: no other has at most their cost and error.

    A point that is not known (NaN) or whose error is infinite is never on it, however little it sends.
    """
    known = np.isfinite(cost) & np.isfinite(error)
    front = known.copy()
    for i in np.flatnonzero(known):
        as_good = known & (cost <= cost[i]) & (error <= error[i])
        front[i] = not np.any(as_good & ((cost < cost[i]) | (error < error[i])))
    return front
