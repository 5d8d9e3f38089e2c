"""Graphs: who is whose neighbour, with which weight."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import networkx
import pytest
from hypothesis import given
from hypothesis import strategies as st

from orchestrator.topology.graph_generators import Complete, Grid, RandomGeometric, Ring
from orchestrator.topology.load import load_topology

TEXT = """\
period_s: 0.1
steps: 20
plant: {model: constant_acceleration, process_noise: {std: 0.2}, initial: {std: 1.0}}
sensors: {s1..s6: {model: linear, C: [[1.0, 0.0, 0.0]], noise: {std: 0.1}}}
estimators:
"""
METHOD = "{method: secure_distributed, coupling: 0.01}"


def neighbours(
    folder: Path, graph: str, estimators: str = f"  e1..e4: {METHOD}\n"
) -> dict[str, Mapping[str, float]]:
    path = folder / "topology.yaml"
    path.write_text(f"{TEXT}{estimators}graph: {graph}\n")
    return {own.name: dict(own.neighbours) for own in load_topology(path).plan.estimators}


def test_a_ring(tmp_path: Path) -> None:
    assert neighbours(tmp_path, "{ring: {nodes: 4}}")["e1"] == {"e2": 0.5, "e4": 0.5}


def test_undirected_edges_lead_both_ways(tmp_path: Path) -> None:
    found = neighbours(tmp_path, "{edges: [[1, 2], [2, 3], [3, 4]]}")
    assert found["e2"] == {"e1": 0.5, "e3": 0.5}
    assert found["e4"] == {"e3": 1.0}


def test_directed_edges_lead_from_the_first_to_the_second(tmp_path: Path) -> None:
    found = neighbours(tmp_path, "{edges: [[1, 2], [2, 3], [3, 4], [4, 1]], directed: true}")
    assert found["e2"] == {"e1": 1.0}


def test_stated_weights_are_kept(tmp_path: Path) -> None:
    found = neighbours(tmp_path, "{edges: [[e1, e2, 0.25], [e2, e3, 0.5], [e3, e4, 0.1]]}")
    assert found["e2"] == {"e1": 0.25, "e3": 0.5}


def test_metropolis_weights_are_symmetric(tmp_path: Path) -> None:
    found = neighbours(tmp_path, "{edges: [[1, 2], [2, 3], [2, 4]], weights: metropolis}")
    assert found["e1"]["e2"] == found["e2"]["e1"] == 0.25


def test_a_graph_lies_over_every_family(tmp_path: Path) -> None:
    found = neighbours(tmp_path, "{ring: {nodes: 3}}", f"  e1..e3: {METHOD}\n  f1..f3: {METHOD}\n")
    assert found["e1"] == {"e2": 0.5, "e3": 0.5}
    assert found["f1"] == {"f2": 0.5, "f3": 0.5}


def test_who_has_no_rounds_has_no_neighbours_and_weighs_nothing(tmp_path: Path) -> None:
    estimators = f"  e1..e3: {METHOD}\n  e4: {{method: kalman}}\n  centre: {{method: kalman_centralized}}\n"
    found = neighbours(tmp_path, "{complete: {nodes: 4}}", estimators)
    assert found["e1"] == {"e2": 0.5, "e3": 0.5}
    assert found["e4"] == found["centre"] == {}


def test_who_loses_all_neighbours_stops_exchanging(tmp_path: Path) -> None:
    idle = "{method: secure_distributed, coupling: 0.0}"
    estimators = f"  e1: {{method: kalman}}\n  e2..e3: {idle}\n  e4..e5: {METHOD}\n"
    graph = "{edges: [[1, 2], [2, 3], [3, 4], [4, 5], [5, 4]], directed: true}"
    found = neighbours(tmp_path, graph, estimators)
    assert found == {"e1": {}, "e2": {}, "e3": {}, "e4": {"e5": 1.0}, "e5": {"e4": 1.0}}


def test_graphml(tmp_path: Path) -> None:
    graph = networkx.path_graph(4)
    networkx.write_graphml(networkx.relabel_nodes(graph, lambda label: label + 1), tmp_path / "path.xml")
    found = neighbours(tmp_path, "{graphml: path.xml}")
    assert found["e2"] == {"e1": 0.5, "e3": 0.5}


def test_graphml_with_weights_and_names(tmp_path: Path) -> None:
    graph = networkx.DiGraph()
    graph.add_weighted_edges_from([("e1", "e2", 0.3), ("e2", "e1", 0.4)])
    networkx.write_graphml(graph, tmp_path / "pair.xml")
    assert neighbours(tmp_path, "{graphml: pair.xml}", f"  e1..e2: {METHOD}\n") == {
        "e1": {"e2": 0.4},
        "e2": {"e1": 0.3},
    }


@given(
    st.one_of(
        st.builds(Complete, nodes=st.integers(1, 12)),
        st.builds(Grid, rows=st.integers(1, 5), columns=st.integers(1, 5)),
        st.builds(Ring, nodes=st.integers(5, 12), neighbours=st.sampled_from([2, 4])),
        st.builds(
            RandomGeometric,
            nodes=st.integers(1, 30),
            radius=st.floats(0.01, 1.5),
            seed=st.integers(0, 2**53),
        ),
    )
)
def test_generated_graphs_are_connected_and_simple(
    generator: Complete | Grid | Ring | RandomGeometric,
) -> None:
    edges = generator.edges()
    assert all(1 <= a < b <= generator.size for a, b in edges)
    assert len(set(edges)) == len(edges)
    graph = networkx.Graph(edges)
    graph.add_nodes_from(range(1, generator.size + 1))
    assert networkx.is_connected(graph)


@pytest.mark.parametrize(
    ("generator", "reference"),
    [
        (Ring(nodes=20, neighbours=4), networkx.watts_strogatz_graph(20, 4, 0.0)),
        (Grid(rows=3, columns=4), networkx.grid_2d_graph(3, 4)),
        (Complete(nodes=7), networkx.complete_graph(7)),
    ],
)
def test_generated_graphs_are_those_of_networkx(
    generator: Ring | Grid | Complete, reference: networkx.Graph
) -> None:
    number = {node: index for index, node in enumerate(sorted(reference.nodes), start=1)}
    expected = {tuple(sorted((number[a], number[b]))) for a, b in reference.edges}
    assert set(generator.edges()) == expected


def test_a_random_geometric_graph_holds_every_near_pair_and_few_others() -> None:
    generator = RandomGeometric(nodes=40, radius=0.15, seed=3)
    at = generator.positions()
    distance = {
        (a, b): float(((at[a - 1] - at[b - 1]) ** 2).sum() ** 0.5)
        for a in range(1, 41)
        for b in range(a + 1, 41)
    }
    near = {pair for pair, d in distance.items() if d <= 0.15}
    parts = networkx.Graph(near)
    parts.add_nodes_from(range(1, 41))
    edges = set(generator.edges())
    assert near <= edges
    assert len(edges - near) == networkx.number_connected_components(parts) - 1
