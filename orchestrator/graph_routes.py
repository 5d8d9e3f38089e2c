"""How links run on a drawing: straight, or bent around the nodes that they have nothing to do with."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from orchestrator.score.gather import Floats

Point = tuple[float, float]

Ends = tuple[str, str]
"""The names of a link's source and destination."""

CLEAR = 0.1
"""How far a link keeps from the middle of a node that is none of its ends, where there is room."""

MANY = 600
"""Most links of a drawing all of which are bent."""

_BENDS = (0.0, *(sign * bend for bend in (0.12, 0.2, 0.3, 0.45, 0.65, 0.9) for sign in (1.0, -1.0)))
_SAMPLES = 24


def curve(start: Point, end: Point, bend: float, samples: int = _SAMPLES) -> Floats:
    """Return points (samples, 2) of a link, from end to end.

    It is the quadratic Bézier curve whose control point stands to the right of the middle of the way (to the
    left, where ``bend`` is negative), ``bend`` times the way's length from it.
    """
    t = np.linspace(0.0, 1.0, samples)[:, None]
    a, b = np.array(start), np.array(end)
    control = 0.5 * (a + b) + bend * np.array([b[1] - a[1], a[0] - b[0]])
    return np.asarray((1.0 - t) ** 2 * a + 2.0 * t * (1.0 - t) * control + t**2 * b, dtype=np.float64)


def bends(
    links: Sequence[Ends], places: Mapping[str, Point], attacked: Collection[Ends] = frozenset()
) -> dict[Ends, float]:
    """Return the bend of each link: the least with which it passes over no node that is none of its ends.

    Where none keeps clear of all others, it is the one that stays farthest from them. Of more than `MANY`
    links only the attacked ones are bent, so that a thicket remains one of straight lines.
    """
    names = list(places)
    at = np.array([places[name] for name in names])
    clear = _clear(at)
    found = dict.fromkeys(links, 0.0)
    for source, destination in links if len(links) <= MANY else attacked:
        others = at[[i for i, name in enumerate(names) if name not in (source, destination)]]
        found[source, destination] = _bend(places[source], places[destination], others, clear)
    return found


def _clear(at: Floats) -> float:
    """Return how far links can keep from nodes: less than `CLEAR` where nodes are crowded."""
    apart = np.hypot(*(at[:, None, :] - at[None, :, :]).transpose(2, 0, 1))
    np.fill_diagonal(apart, np.inf)
    return min(CLEAR, 0.45 * float(apart.min(initial=np.inf)))


def _bend(start: Point, end: Point, others: Floats, clear: float) -> float:
    best, farthest = 0.0, -1.0
    if start == end or not others.size:
        return best
    for bend in _BENDS:
        distance = _distance(curve(start, end, bend, _SAMPLES if bend else 2), others)
        if distance >= clear:
            return bend
        if distance > farthest:
            best, farthest = bend, distance
    return best


def _distance(way: Floats, others: Floats) -> float:
    """Return how near a way (S, 2) comes to the nearest of points (N, 2)."""
    begin, along = way[:-1, None], np.diff(way, axis=0)[:, None]
    share = np.sum((others - begin) * along, axis=2) / np.sum(along * along, axis=2)
    foot = begin + np.clip(share, 0.0, 1.0)[:, :, None] * along
    return float(np.hypot(*np.moveaxis(others - foot, 2, 0)).min())
