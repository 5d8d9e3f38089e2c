"""Gilbert-Elliott chains from recorded losses: what failure and recovery rates a real link has."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bus.packets import Vector

Losses = NDArray[np.bool_]
"""Whether each of a link's slots was lost, in their order."""

_STARTS = ((0.02, 0.3, 0.0, 0.9), (0.1, 0.1, 0.01, 0.5), (0.3, 0.5, 0.1, 0.9))
"""Where the search of the full chain begins: failure, recovery, loss_good, loss_bad."""


@dataclass(frozen=True)
class GilbertFit:
    """The chain that loses in its bad state only, with standard errors: infinite where nothing was seen."""

    failure: float
    recovery: float
    failure_error: float
    recovery_error: float
    log_likelihood: float

    @property
    def parameters(self) -> dict[str, float]:
        """The parameters as `gilbert_elliott` takes them."""
        return {"failure": self.failure, "recovery": self.recovery}


@dataclass(frozen=True)
class GilbertElliottFit:
    """The chain with losses in both states; ``iterations`` of the search that found it."""

    failure: float
    recovery: float
    loss_good: float
    loss_bad: float
    log_likelihood: float
    iterations: int
    converged: bool

    @property
    def parameters(self) -> dict[str, float]:
        """The parameters as `gilbert_elliott` takes them."""
        return {
            "failure": self.failure,
            "recovery": self.recovery,
            "loss_good": self.loss_good,
            "loss_bad": self.loss_bad,
        }


def _rate(moved: int, stayed: int) -> tuple[float, float, float]:
    """Return a transition's maximum likelihood rate, its standard error, and its log-likelihood."""
    total = moved + stayed
    if not total:
        return 0.0, math.inf, 0.0
    rate = moved / total
    likelihood = sum(count * math.log(share) for count, share in ((moved, rate), (stayed, 1 - rate)) if count)
    return rate, math.sqrt(rate * (1.0 - rate) / total), likelihood


def fit_gilbert(losses: Losses) -> GilbertFit:
    """Return the simple chain of greatest likelihood, given the first slot, in closed form.

    The counts of transitions are sufficient: ``failure = n01 / (n00 + n01)`` and
    ``recovery = n10 / (n10 + n11)`` with 1 for a lost slot; the standard errors are those of the Fisher
    information. Raises ValueError for fewer than two slots.
    """
    if losses.size < 2:
        raise ValueError("a fit needs at least two slots")
    before, after = losses[:-1], losses[1:]
    failure, failure_error, from_good = _rate(int((~before & after).sum()), int((~before & ~after).sum()))
    recovery, recovery_error, from_bad = _rate(int((before & ~after).sum()), int((before & after).sum()))
    return GilbertFit(failure, recovery, failure_error, recovery_error, from_good + from_bad)


def fit_gilbert_elliott(
    losses: Losses, *, most_iterations: int = 500, tolerance: float = 1e-9
) -> GilbertElliottFit:
    """Return the full chain of greatest likelihood that Baum and Welch's algorithm finds from several starts.

    The chain is taken as stationary at the first slot. The state with more losses is called bad. It ends when
    an iteration raises the log-likelihood by less than ``tolerance`` a slot. Raises ValueError for fewer than
    two slots, and where all slots have the same fate, which any chain could explain.
    """
    if losses.size < 2:
        raise ValueError("a fit needs at least two slots")
    if losses.all() or not losses.any():
        raise ValueError("all slots have the same fate: nothing tells the two states apart")
    fits = [_baum_welch(losses, start, most_iterations, tolerance * losses.size) for start in _STARTS]
    return max(fits, key=lambda fit: fit.log_likelihood)


def _baum_welch(
    losses: Losses, start: Sequence[float], most_iterations: int, tolerance: float
) -> GilbertElliottFit:
    failure, recovery, loss_good, loss_bad = start
    last = -math.inf
    likelihood, iterations, converged = last, 0, False
    while iterations < most_iterations:
        iterations += 1
        emission = np.where(losses[:, None], [loss_good, loss_bad], [1.0 - loss_good, 1.0 - loss_bad])
        occupied, moved, likelihood = _expect(emission, failure, recovery)
        converged = likelihood - last < tolerance
        if converged:
            break
        last = likelihood
        good, bad = occupied[:-1].sum(axis=0).tolist()
        failure, recovery = _share(moved[0], good), _share(moved[1], bad)
        loss_good, loss_bad = (
            _share(float(occupied[losses, state].sum()), float(occupied[:, state].sum())) for state in (0, 1)
        )
    if loss_good > loss_bad:
        failure, recovery, loss_good, loss_bad = recovery, failure, loss_bad, loss_good
    return GilbertElliottFit(failure, recovery, loss_good, loss_bad, likelihood, iterations, converged)


def _share(part: float, whole: float) -> float:
    """Return a share, kept off 0 and 1 where the search would stick, and off a division by nothing."""
    return min(max(part / whole, 1e-12), 1.0 - 1e-12) if whole > 0.0 else 0.5


def _expect(emission: Vector, failure: float, recovery: float) -> tuple[Vector, tuple[float, float], float]:
    """Return P(state | losses) (T, 2), the expected numbers of moves to bad and to good, log P(losses).

    The scaled forward and backward passes, in plain numbers: two states are too few for arrays to pay.
    """
    stay_good, stay_bad = 1.0 - failure, 1.0 - recovery
    rows = emission.tolist()
    total = failure + recovery
    good, bad = (recovery / total, failure / total) if total else (0.5, 0.5)
    forward, scales = [], []
    for index, (seen_good, seen_bad) in enumerate(rows):
        if index:
            good, bad = good * stay_good + bad * recovery, good * failure + bad * stay_bad
        good, bad = good * seen_good, bad * seen_bad
        scale = good + bad
        good, bad = good / scale, bad / scale
        forward.append((good, bad))
        scales.append(scale)
    occupied = [forward[-1]]
    after_good = after_bad = 1.0
    failures = recoveries = 0.0
    for index in range(len(rows) - 2, -1, -1):
        scale = scales[index + 1]
        next_good, next_bad = rows[index + 1][0] * after_good / scale, rows[index + 1][1] * after_bad / scale
        good, bad = forward[index]
        failures += good * failure * next_bad
        recoveries += bad * recovery * next_good
        after_good = stay_good * next_good + failure * next_bad
        after_bad = recovery * next_good + stay_bad * next_bad
        occupied.append((good * after_good, bad * after_bad))
    return np.array(occupied[::-1]), (failures, recoveries), sum(map(math.log, scales))
