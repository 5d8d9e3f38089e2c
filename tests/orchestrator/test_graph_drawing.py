"""Drawings of networks say who is attacked: no link passes over a node that it has nothing to do with."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bus.plan import Plan
from orchestrator.graph_drawing import drawing, drawn_links, layout
from orchestrator.graph_routes import CLEAR, MANY, bends, curve
from orchestrator.report.contents import Trace
from orchestrator.report.network import network_figure
from orchestrator.report.recording import read_recording
from orchestrator.run import run_topology
from orchestrator.run_directory import make_run_directory
from orchestrator.topology.load import load_topology

TOPOLOGIES = Path(__file__).parents[2] / "topologies"
DRAWN = ["adversary/sybil", "forti2019/injection", "zhou2020/ring", "adversary/covert"]
NODE = 0.07
"""How far from its middle a node reaches in the drawing."""


def plan_of(name: str) -> Plan:
    return load_topology(TOPOLOGIES / f"{name}.yaml").plan


def nearest(way: np.ndarray, place: tuple[float, float]) -> float:
    return float(np.hypot(*(way - np.array(place)).T).min())


@pytest.mark.parametrize("name", [*DRAWN, "ding2021/case_b"])
def test_no_link_passes_over_a_node_that_is_none_of_its_ends(name: str) -> None:
    plan = plan_of(name)
    places = layout(plan)
    for (source, destination), bend in bends([link.ends for link in drawn_links(plan)], places).items():
        way = curve(places[source], places[destination], bend, samples=200)
        for other in places.keys() - {source, destination}:
            assert nearest(way, places[other]) > NODE, f"{source}->{destination} passes over {other}"


def test_a_link_with_nothing_in_its_way_is_straight() -> None:
    places = {"a": (0.0, 0.0), "b": (1.0, 0.0), "c": (0.5, 2.0 * CLEAR), "d": (0.5, 0.01)}
    link = "a", "b"
    assert bends([link], {name: places[name] for name in "abc"}) == {link: 0.0}
    assert bends([link], places)[link] != 0.0
    assert bends([link], {name: places[name] for name in "ab"}) == {link: 0.0}


def test_of_very_many_links_the_attacked_ones_still_bend() -> None:
    places = {f"n{i}": (0.1 * i, 0.0) for i in range(40)}
    links = [(a, b) for a in places for b in places if a != b]
    assert len(links) > MANY
    bent = bends(links, places, [("n0", "n2")])
    assert {link for link, bend in bent.items() if bend} == {("n0", "n2")}


def test_a_bend_is_to_the_right_of_the_way_as_matplotlib_has_it() -> None:
    from matplotlib.patches import ConnectionStyle

    path = ConnectionStyle.Arc3(rad=0.3).connect((0.0, 0.0), (2.0, 1.0))
    middle = curve((0.0, 0.0), (2.0, 1.0), 0.3, samples=3)[1]
    start, control, end = np.asarray(path.vertices)
    np.testing.assert_allclose(middle, 0.25 * start + 0.5 * control + 0.25 * end)


@pytest.mark.parametrize(("name", "ringed"), [("forti2019/injection", True), ("adversary/sybil", False)])
def test_a_plant_that_a_signal_attacks_is_ringed(name: str, ringed: bool) -> None:
    from matplotlib.colors import to_hex

    axes = drawing(plan_of(name)).axes[0]
    plant = axes.collections[0]
    assert (to_hex(plant.get_edgecolor()[0]) == "#c1121f") is ringed


def test_no_arrow_strikes_the_caption_of_the_plant_through() -> None:
    plan = plan_of("adversary/covert")
    figure = drawing(plan)
    figure.draw_without_rendering()
    axes = figure.axes[0]
    caption = next(text for text in axes.texts if text.get_text() == "measured by every sensor")
    box = caption.get_window_extent().transformed(axes.transData.inverted())
    places = layout(plan)
    for link in drawn_links(plan):
        way = curve(places[link.source], places[link.destination], 0.0, samples=200)
        assert not any(box.contains(*point) for point in way)


def network(home: Path, name: str, *settings: str) -> list[Trace]:
    """Return the traces of the network in the report of a short run."""
    topology = load_topology(TOPOLOGIES / f"{name}.yaml", settings)
    directory = make_run_directory(home, "run", 1)
    run_topology(topology, directory, "inprocess", lambda recorded: None)
    return list(network_figure(read_recording(directory / "run.mcap")).initial.traces)


def pieces(traces: list[Trace]) -> list[np.ndarray]:
    """Return the points of every line, dense enough to meet all that it passes over."""
    found = []
    for trace in traces:
        if trace["mode"] == "lines":
            x, y = (np.array(trace[axis], dtype=np.float64) for axis in "xy")
            for own in np.split(np.column_stack([x, y]), np.flatnonzero(np.isnan(x))):
                own = own[~np.isnan(own[:, 0])]
                if len(own):
                    dense = np.linspace(0, len(own) - 1, 400)
                    found.append(np.column_stack([np.interp(dense, np.arange(len(own)), c) for c in own.T]))
    return found


@pytest.mark.parametrize("name", ["adversary/sybil", "zhou2020/ring"])
def test_in_the_report_every_link_meets_its_two_ends_and_no_other_node(tmp_path: Path, name: str) -> None:
    traces = network(tmp_path, name)
    places = layout(plan_of(name))
    drawn = pieces(traces)
    assert len(drawn) == len(plan_of(name).links)
    for way in drawn:
        met = [node for node, place in places.items() if nearest(way, place) < NODE]
        assert len(met) == 2, met


def test_the_report_rings_a_plant_that_a_signal_attacked(tmp_path: Path) -> None:
    traces = network(tmp_path, "forti2019/injection", "steps=350", "expect=null")
    plant = next(trace for trace in traces if trace.get("name") == "plant")
    assert plant["marker"]["line"]["color"] == ["$attack"]
    assert "under a signal attack in 200 steps" in plant["hovertext"][0]


def test_the_report_rings_no_plant_that_was_left_alone(tmp_path: Path) -> None:
    traces = network(tmp_path, "adversary/sybil")
    plant = next(trace for trace in traces if trace.get("name") == "plant")
    assert plant["marker"]["line"]["color"] == ["$ink"]
