"""From a graph to links between estimators: laid over each family, with the weights ``h_ij``."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

from orchestrator.topology.draft import Draft
from orchestrator.topology.graph import Graph
from orchestrator.topology.names import split_number
from orchestrator.topology.problems import did_you_mean

Edges = dict[tuple[str, str], float | None]
"""Directed edges between estimators, with their weights where the topology states them."""


@dataclass(frozen=True)
class LaidGraph:
    """A graph laid over estimators; ``unfit`` tells for each family over which it cannot lie why not."""

    edges: Edges
    unfit: Mapping[str, str]


def families(names: Iterable[str]) -> dict[str, dict[int, str]]:
    """Return the names of each family by their numbers; a name without a number is in none."""
    found: dict[str, dict[int, str]] = {}
    for name in names:
        family, number = split_number(name)
        if number is not None:
            found.setdefault(family, {})[number] = name
    return found


def lay(draft: Draft, graph: Graph, estimators: Sequence[str]) -> LaidGraph:
    """Lay a graph over each family of estimators, or over the estimators that its edges name."""
    named = [
        edge for edge in graph.edges if isinstance(edge.source, str) or isinstance(edge.destination, str)
    ]
    if named:
        return LaidGraph(_named_edges(draft, graph, estimators), {})
    edges: Edges = {}
    unfit: dict[str, str] = {}
    for family, members in families(estimators).items():
        fault = _misfit(graph, family, members)
        if fault:
            unfit[family] = fault
            continue
        for edge in graph.edges:
            source, destination = members[int(edge.source)], members[int(edge.destination)]
            _put(edges, source, destination, edge.weight, graph.directed)
    return LaidGraph(edges, unfit)


def _put(edges: Edges, source: str, destination: str, weight: float | None, directed: bool) -> None:
    edges[source, destination] = weight
    if not directed:
        edges[destination, source] = weight


def _named_edges(draft: Draft, graph: Graph, estimators: Sequence[str]) -> Edges:
    edges: Edges = {}
    for edge in graph.edges:
        unknown = [label for label in (edge.source, edge.destination) if label not in estimators]
        for label in unknown:
            draft.complain(
                edge.path, f"there is no estimator '{label}'", did_you_mean(str(label), estimators)
            )
        if not unknown:
            _put(edges, str(edge.source), str(edge.destination), edge.weight, graph.directed)
    return edges


def _misfit(graph: Graph, family: str, members: Mapping[int, str]) -> str:
    """Return why a graph of numbers cannot lie over a family, empty when it can."""
    span = f"{family}{min(members)}..{family}{max(members)}"
    if graph.size is not None:
        if members.keys() == set(range(1, graph.size + 1)):
            return ""
        return f"the graph has nodes 1 to {graph.size}, and {span} are {len(members)} estimators"
    labels = {int(label) for edge in graph.edges for label in (edge.source, edge.destination)}
    strangers = sorted(labels - members.keys())
    return f"the graph has a node {strangers[0]}, and there is no {family}{strangers[0]}" if strangers else ""


def weighted(edges: Edges, rule: str) -> dict[tuple[str, str], float]:
    """Return the edges with their weights: as stated, or by a rule.

    ``in_degree``: ``h_ij = 1 / (in-degree of i)``, so that the weights of each receiver i sum to one.
    ``metropolis``: ``h_ij = 1 / (1 + max(in-degree of i, in-degree of j))``.
    """
    degree: dict[str, int] = {}
    for _, destination in edges:
        degree[destination] = degree.get(destination, 0) + 1
    result = {}
    for (source, destination), stated in edges.items():
        if stated is not None:
            result[source, destination] = stated
        elif rule == "metropolis":
            result[source, destination] = 1.0 / (1 + max(degree[destination], degree.get(source, 0)))
        else:
            result[source, destination] = 1.0 / degree[destination]
    return result


def unreached(edges: Collection[tuple[str, str]], names: Sequence[str]) -> tuple[str, str] | None:
    """Return two nodes (a, b) such that nothing of a ever reaches b, None when everyone reaches everyone."""
    start = names[0]
    forward = _reachable(edges, start)
    for name in names:
        if name not in forward:
            return start, name
    backward = _reachable([(b, a) for a, b in edges], start)
    return next(((name, start) for name in names if name not in backward), None)


def _reachable(edges: Collection[tuple[str, str]], start: str) -> set[str]:
    following: dict[str, list[str]] = {}
    for source, destination in edges:
        following.setdefault(source, []).append(destination)
    reached, waiting = {start}, [start]
    while waiting:
        for name in following.get(waiting.pop(), []):
            if name not in reached:
                reached.add(name)
                waiting.append(name)
    return reached
