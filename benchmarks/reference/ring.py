"""The ring that the HELICS and mosaik references compute, and the form of their results.

Node `i` of `n` has four neighbours, two on each side, and at step `k` takes

    x_i(k) = 0.9 * mean(x_j(k - 1) for its neighbours j) + sin(k * (i + 1)),    x_i(-1) = 0.

The mathematics is trivial on purpose: what is measured is the exchange. The forcing differs in every node and
step, so that a value read from the wrong neighbour, or one step too late, shows in the final state.
"""

import json
import math
from collections.abc import Iterable

OFFSETS = (-2, -1, 1, 2)


def neighbours(node: int, nodes: int) -> list[int]:
    """Return the four nodes whose previous values `node` averages."""
    return [(node + offset) % nodes for offset in OFFSETS]


def update(step: int, node: int, received: Iterable[float]) -> float:
    """Return the value of `node` at `step` from the four values that its neighbours had one step before."""
    return 0.9 * sum(received) / len(OFFSETS) + math.sin(step * (node + 1))


def agrees(values: Iterable[float], steps: int) -> bool:
    """Tell whether the final values equal those of a plain numpy simulation of the same recurrence."""
    import numpy as np

    final = np.array(list(values))
    state = np.zeros(len(final))
    for step in range(steps):
        mean = sum(np.roll(state, -offset) for offset in OFFSETS) / len(OFFSETS)
        state = 0.9 * mean + np.sin(step * np.arange(1, len(final) + 1))
    return bool(np.allclose(final, state, rtol=1e-12, atol=1e-12))


def report(name: str, nodes: int, steps: int, *, start_up_s: float, run_s: float, checked: bool) -> str:
    """Return the JSON line that every reference prints."""
    return json.dumps(
        {
            "reference": name,
            "nodes": nodes,
            "steps": steps,
            "steps_per_s": round(steps / run_s, 1),
            "start_up_s": round(start_up_s, 3),
            "checked": checked,
        }
    )
