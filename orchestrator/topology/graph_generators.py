"""Graphs by name and size. Every generator makes an undirected, connected graph on the numbers 1 to n.

A kind is constructed as ``Kind(**parameters)`` and has ``edges()``.
"""

from __future__ import annotations

from itertools import combinations
from typing import Annotated, Protocol

import numpy as np
from annotated_types import Ge, Gt, Le

from bus.random_streams import random_stream

Edge = tuple[int, int]
Count = Annotated[int, Ge(1), Le(100_000)]


class GraphGenerator(Protocol):
    """What a graph kind offers."""

    @property
    def size(self) -> int:
        """Number of nodes."""
        ...

    def edges(self) -> list[Edge]:
        """Return every edge once."""
        ...


class Ring:
    """A ring in which everyone is linked to its nearest ``neighbours``, half of them on either side.

    Parameters
    ----------
    nodes
        Number of nodes.
    neighbours
        Neighbours of each node: even, and less than ``nodes``.
    """

    def __init__(self, *, nodes: Count, neighbours: Annotated[int, Ge(2)] = 2) -> None:
        if neighbours % 2 or neighbours >= nodes:
            raise ValueError(f"neighbours is {neighbours}; give an even number less than nodes ({nodes})")
        self.size = nodes
        self._reach = neighbours // 2

    def edges(self) -> list[Edge]:
        """Return every edge once."""
        n = self.size
        pairs = ((i, (i + hop) % n) for i in range(n) for hop in range(1, self._reach + 1))
        return sorted({(min(a, b) + 1, max(a, b) + 1) for a, b in pairs})


class Grid:
    """A rectangular grid, numbered row by row; everyone is linked to the nodes beside, above and below it.

    Parameters
    ----------
    rows
        Number of nodes from top to bottom.
    columns
        Number of nodes from left to right.
    """

    def __init__(self, *, rows: Count, columns: Count) -> None:
        self.size = rows * columns
        self._columns = columns

    def edges(self) -> list[Edge]:
        """Return every edge once."""
        beside = [(i, i + 1) for i in range(1, self.size + 1) if i % self._columns]
        below = [(i, i + self._columns) for i in range(1, self.size - self._columns + 1)]
        return sorted(beside + below)


class Complete:
    """Everyone is linked to everyone.

    Parameters
    ----------
    nodes
        Number of nodes.
    """

    def __init__(self, *, nodes: Count) -> None:
        self.size = nodes

    def edges(self) -> list[Edge]:
        """Return every edge once."""
        return list(combinations(range(1, self.size + 1), 2))


class RandomGeometric:
    """Nodes thrown on the unit square, linked when they are near, and then made connected.

    Pairs are visited from the nearest to the farthest: those within ``radius`` are linked, and of the
    others those that join two parts that were still apart. So the graph keeps its radius and gets the
    fewest and shortest bridges.

    Parameters
    ----------
    nodes
        Number of nodes.
    radius
        Distance up to which two nodes are linked.
    seed
        Seed of the positions. It is the graph's own: another seed of the run does not move the nodes.
    """

    def __init__(
        self, *, nodes: Count, radius: Annotated[float, Gt(0.0)], seed: Annotated[int, Ge(0)] = 0
    ) -> None:
        self.size = nodes
        self._radius = radius
        self._seed = seed

    def positions(self) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
        """Return the positions (nodes, 2)."""
        return random_stream(self._seed, 0, "graph", "positions").random((self.size, 2))

    def edges(self) -> list[Edge]:
        """Return every edge once."""
        at = self.positions()
        first, second = np.triu_indices(self.size, k=1)
        distance = np.hypot(*(at[first] - at[second]).T)
        part = list(range(self.size))
        edges = []
        for index in np.argsort(distance, kind="stable").tolist():
            a, b = int(first[index]), int(second[index])
            if distance[index] > self._radius and part[a] == part[b]:
                continue
            edges.append((a + 1, b + 1))
            if part[a] != part[b]:
                joined, gone = part[a], part[b]
                part = [joined if label == gone else label for label in part]
        return sorted(edges)
