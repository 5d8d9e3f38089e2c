"""Who exchanges with whom: the graph laid over the estimators that exchange at all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from orchestrator.topology.construction import EstimatorBuilder
from orchestrator.topology.draft import CheckedKind, Draft
from orchestrator.topology.graph import Graph
from orchestrator.topology.laying import Edges, LaidGraph, lay, unreached, weighted
from orchestrator.topology.names import split_number

Neighbours = dict[str, dict[str, float]]


@dataclass(frozen=True)
class Wiring:
    """The neighbours of each estimator, in-neighbour to weight and sorted, and its exchange rounds."""

    neighbours: Neighbours
    rounds: Mapping[str, int]


def _by_receiver(edges: Edges, rule: str, names: Sequence[str]) -> Neighbours:
    found: Neighbours = {name: {} for name in names}
    for (source, destination), weight in sorted(weighted(edges, rule).items()):
        found[destination][source] = weight
    return found


def wire(
    draft: Draft, graph: Graph | None, kinds: Mapping[str, CheckedKind], builder: EstimatorBuilder
) -> Wiring:
    """Return who exchanges with whom.

    An estimator tells its number of rounds when it is built with all the neighbours that the graph gives
    it. Those with no rounds get no exchange links, and the others' weights are those of the graph without
    them. A cycle without delay cannot be stated: a round's payloads depend on earlier rounds only, and the
    next step on this one.
    """
    names = list(kinds)
    laid = lay(draft, graph, names) if graph is not None else LaidGraph({}, {})
    rule = graph.weights if graph is not None else "in_degree"
    edges, rounds, neighbours = _settled(laid.edges, rule, names, builder)
    exchanging = [name for name in names if rounds[name]]
    _check_laid(draft, graph, laid, exchanging)
    _check_pairs(draft, edges, kinds, rounds)
    _warn_of_gaps(draft, edges, exchanging)
    return Wiring(neighbours, rounds)


def _settled(
    edges: Edges, rule: str, names: Sequence[str], builder: EstimatorBuilder
) -> tuple[Edges, dict[str, int], Neighbours]:
    """Return the edges between those that exchange; who loses all neighbours by that may stop too."""
    neighbours = _by_receiver(edges, rule, names)
    rounds = {name: builder.rounds(name, neighbours[name]) for name in names}
    while not all(rounds[source] and rounds[destination] for source, destination in edges):
        edges = {ends: weight for ends, weight in edges.items() if all(rounds[end] for end in ends)}
        before, neighbours = neighbours, _by_receiver(edges, rule, names)
        changed = [name for name in names if neighbours[name] != before[name]]
        rounds |= {name: builder.rounds(name, neighbours[name]) for name in changed}
    return edges, rounds, neighbours


def _check_laid(draft: Draft, graph: Graph | None, laid: LaidGraph, exchanging: Sequence[str]) -> None:
    if graph is None:
        for name in exchanging[:1]:
            cure = f"add 'graph: {{ring: {{nodes: {len(exchanging)}}}}}', or 'graph: {{edges: []}}' for none"
            draft.complain(
                ("estimators", name), f"{name} exchanges with neighbours, and there is no graph", cure
            )
        return
    if graph.edges and not exchanging:
        draft.warn(("graph",), "no estimator exchanges with neighbours: the graph is not used", "take it out")
    for family in dict.fromkeys(split_number(name)[0] for name in exchanging):
        if family in laid.unfit:
            cure = "give both the same size, or name the estimators in 'edges'"
            draft.complain(("graph",), laid.unfit[family], cure)
    labelled_by_number = any(isinstance(edge.source, int) for edge in graph.edges)
    for name in exchanging:
        if labelled_by_number and split_number(name)[1] is None:
            cure = f"call it {name}1 and so on, or name the estimators in 'edges'"
            draft.complain(("estimators", name), f"{name} has no number to stand in the graph with", cure)


def _check_pairs(
    draft: Draft, edges: Edges, kinds: Mapping[str, CheckedKind], rounds: Mapping[str, int]
) -> None:
    """Refuse unlike numbers of rounds and warn of unlike methods, once a pair of kinds."""
    told: set[frozenset[type]] = set()
    for source, destination in edges:
        a, b = kinds[source].found.type, kinds[destination].found.type
        if frozenset({a, b}) in told:
            continue
        path = ("estimators", destination, "method")
        if rounds[source] != rounds[destination]:
            counts = (
                f"{source} has {rounds[source]} and its neighbour {destination} has {rounds[destination]}"
            )
            cure = "give both as many, or take their edge out"
            draft.complain(path, f"exchange rounds a step differ: {counts}", cure)
            told.add(frozenset({a, b}))
        elif not (issubclass(a, b) or issubclass(b, a)):
            ends = f"{destination} ({b.__name__}) and its neighbour {source} ({a.__name__})"
            cure = (
                "see that one reads the other's payloads, or give them other names, as families of their own"
            )
            told.add(frozenset({a, b}))
            draft.warn(path, f"{ends} do not share one method", cure)


def _warn_of_gaps(draft: Draft, edges: Edges, exchanging: Sequence[str]) -> None:
    for members in _linked_families(edges, exchanging):
        inside = [ends for ends in edges if ends[0] in members]
        gap = unreached(inside, members)
        if gap is not None:
            message = f"the graph is not connected: nothing of {gap[0]} ever reaches {gap[1]}"
            draft.warn(("graph",), message, "add an edge")


def _linked_families(edges: Edges, names: Sequence[str]) -> list[list[str]]:
    """Return the estimators by family, families that an edge joins together."""
    group = {name: split_number(name)[0] for name in names}
    for source, destination in edges:
        if group[source] != group[destination]:
            joined, gone = group[source], group[destination]
            group = {name: joined if label == gone else label for name, label in group.items()}
    members: dict[str, list[str]] = {}
    for name in names:
        members.setdefault(group[name], []).append(name)
    return list(members.values())
