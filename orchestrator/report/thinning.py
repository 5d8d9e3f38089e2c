"""Keeps pages small: long series by their extremes, many nodes by those that matter."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from orchestrator.score.gather import Bools, Floats, Ints
from orchestrator.score.results import NodeScore, Score

POINTS = 2000
"""The most points of a line; a screen has no more columns."""

VALUES = 150_000
"""The most points of all lines of a figure together, as far as each keeps `FEWEST`."""

FEWEST = 300

STRETCHES = 60
"""The most shaded stretches of a figure."""


def points(lines: int) -> int:
    """Return how many points each of so many lines of a figure may have."""
    return int(np.clip(VALUES // max(lines, 1), FEWEST, POINTS))


def kept(values: Floats, most: int = POINTS) -> Ints:
    """Return the indices at which a long series is drawn: all of a short one.

    A series longer than ``most`` is cut into stretches of equal length, of each of which its smallest and its
    largest value are kept, in their order, and the first and the last of all: no peak is lost.
    """
    size = values.size
    if size <= most:
        return np.arange(size)
    stretches = max(most // 2 - 1, 1)
    edges = np.linspace(0, size, stretches + 1).astype(np.int64)
    low = np.where(np.isfinite(values), values, np.inf)
    high = np.where(np.isfinite(values), values, -np.inf)
    chosen = {0, size - 1}
    for begin, end in pairwise(edges.tolist()):
        chosen |= {begin + int(np.argmin(low[begin:end])), begin + int(np.argmax(high[begin:end]))}
    return np.array(sorted(chosen), dtype=np.int64)


def binned(counts: Ints, most: int = POINTS // 4) -> tuple[Ints, Ints, int]:
    """Return sums of counts (..., K) over stretches of whole steps: first steps, sums, steps a stretch."""
    size = counts.shape[-1]
    width = max(1, -(-size // most))
    starts = np.arange(0, size, width)
    return starts, np.add.reduceat(counts, starts, axis=-1) if size else counts, width


def stretches_of(marks: Bools, most: int = STRETCHES) -> list[tuple[int, int]]:
    """Return the runs of marked steps (first, last).

    Where there are more than ``most`` runs, neighbours are joined over gaps that grow until there are not.
    """
    steps = np.flatnonzero(marks)
    if not steps.size:
        return []
    gap = 1
    while True:
        breaks = np.flatnonzero(np.diff(steps) > gap)
        if breaks.size < most:
            break
        gap *= 2
    first = steps[np.concatenate([[0], breaks + 1])]
    last = steps[np.concatenate([breaks, [steps.size - 1]])]
    return list(zip(first.tolist(), last.tolist(), strict=True))


def _badness(node: NodeScore) -> float:
    rmse = node.groups["state"].rmse
    return float("inf") if rmse is None else rmse


def leading_nodes(score: Score, most: int) -> list[str]:
    """Return the estimators to show first, the most telling first.

    Attacked ones by falling error, then the worst, the best and the median; then the rest by falling error.
    """
    ranked = sorted(score.nodes, key=lambda node: -_badness(node))
    attacked = [node.name for node in ranked if node.attacked_steps]
    names = [node.name for node in ranked]
    middle = [names[0], names[-1], names[len(names) // 2]] if names else []
    return list(dict.fromkeys([*attacked, *middle, *names]))[:most]


def in_order(chosen: Sequence[str], names: Sequence[str]) -> list[str]:
    """Return the chosen names in the order of all names."""
    held = set(chosen)
    return [name for name in names if name in held]
