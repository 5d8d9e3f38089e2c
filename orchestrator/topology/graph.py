"""The section ``graph``: from a generator, from edges, or from a GraphML file to labelled edges."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from orchestrator.topology.draft import Draft
from orchestrator.topology.graph_generators import GraphGenerator
from orchestrator.topology.problems import PathKeys
from orchestrator.topology.schema import GraphSection

Label = int | str


@dataclass(frozen=True)
class LabelledEdge:
    """An edge of a graph before it is laid over estimators: labels are numbers, or names of estimators."""

    source: Label
    destination: Label
    weight: float | None
    path: PathKeys


@dataclass(frozen=True)
class Graph:
    """A graph as a topology states it. ``size`` is None when any label may occur (edges, GraphML)."""

    edges: tuple[LabelledEdge, ...]
    directed: bool
    weights: str
    size: int | None


def read_graph(draft: Draft) -> Graph | None:
    """Return the graph that the topology states, None when it states none or a wrong one (noted)."""
    section: GraphSection | None = draft.sections.get("graph")
    if section is None:
        return None
    given = [*section.parameters, *(key for key in ("edges", "graphml") if getattr(section, key) is not None)]
    if len(given) != 1:
        listed = ", ".join(given) or "none"
        cure = "give one generator, for example 'ring: {nodes: 20, neighbours: 4}', or 'edges', or 'graphml'"
        draft.complain(("graph",), f"a graph is given in exactly one way, here: {listed}", cure)
        return None
    if section.edges is not None:
        return _explicit(draft, section.edges, section)
    if section.graphml is not None:
        return _graphml(draft, section.graphml, section)
    return _generated(draft, given[0], section)


def _generated(draft: Draft, name: str, section: GraphSection) -> Graph | None:
    path = ("graph", name)
    stated = section.parameters[name]
    if not isinstance(stated, dict):
        draft.complain(path, f"the parameters of {name} are not a mapping", "write {nodes: 20}")
        return None
    if section.directed:
        draft.complain(("graph", "directed"), "a generated graph is undirected", "take 'directed' out")
    checked = draft.check_kind("graphs", name, path, path, stated)
    if checked is None:
        return None
    try:
        generator: GraphGenerator = checked.found.type(**checked.parameters)
        edges = generator.edges()
    except ValueError as error:
        draft.complain(path, str(error))
        return None
    labelled = tuple(LabelledEdge(a, b, None, path) for a, b in edges)
    return Graph(labelled, False, section.weights, generator.size)


def _explicit(draft: Draft, rows: Sequence[Sequence[Label | float]], section: GraphSection) -> Graph:
    edges: list[LabelledEdge] = []
    for index, row in enumerate(rows):
        path = ("graph", "edges", index)
        edge = _edge(draft, row, path)
        if edge is not None:
            edges.append(edge)
    if len({edge.weight is None for edge in edges}) > 1:
        draft.complain(("graph", "edges"), "some edges have a weight and some have none", "weigh all or none")
    _refuse_repeated(draft, edges, section.directed)
    return Graph(tuple(edges), section.directed, section.weights, None)


def _edge(draft: Draft, row: Sequence[Label | float], path: PathKeys) -> LabelledEdge | None:
    if len(row) not in (2, 3) or any(isinstance(label, float) for label in row[:2]):
        draft.complain(
            path, f"{list(row)} is not an edge", "write [1, 2], [e1, e2], or [e1, e2, 0.5] with a weight"
        )
        return None
    source, destination = (label for label in row[:2] if not isinstance(label, float))
    weight = row[2] if len(row) == 3 else None
    if source == destination:
        draft.complain(
            path, f"{source} is linked with itself", "take the edge out: a node always knows its own belief"
        )
        return None
    if weight is not None and (isinstance(weight, str) or not weight > 0):
        draft.complain(
            path, f"the weight {weight!r} is not a positive number", "take the edge out to have no link"
        )
        return None
    return LabelledEdge(source, destination, None if weight is None else float(weight), path)


def _refuse_repeated(draft: Draft, edges: Iterable[LabelledEdge], directed: bool) -> None:
    seen: set[object] = set()
    for edge in edges:
        ends = (edge.source, edge.destination) if directed else frozenset({edge.source, edge.destination})
        if ends in seen:
            cure = "keep one of them" if directed else "keep one of them, or write 'directed: true'"
            draft.complain(edge.path, f"the edge [{edge.source}, {edge.destination}] is there twice", cure)
        seen.add(ends)


def _graphml(draft: Draft, name: str, section: GraphSection) -> Graph | None:
    import networkx

    path = ("graph", "graphml")
    file: Path = draft.root.nearest(path)[0].origin.directory / name
    try:
        read = networkx.read_graphml(file)
    except FileNotFoundError:
        draft.complain(path, f"there is no file '{name}'", "paths are relative to the topology file")
        return None
    except Exception as error:
        draft.complain(path, f"'{name}' is not GraphML: {type(error).__name__}: {error}")
        return None
    numbered = all(str(label).isdigit() for label in read.nodes)
    rows: list[list[Label | float]] = []
    for a, b, data in read.edges(data=True):
        labels: list[Label | float] = [int(a), int(b)] if numbered else [str(a), str(b)]
        rows.append(labels + ([float(data["weight"])] if "weight" in data else []))
    return _explicit(draft, rows, section.model_copy(update={"directed": read.is_directed()}))
