"""Axes that are cut: what must be seen stays in sight, and what lies beyond stands at the edge."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from orchestrator.report.contents import Figure, Page, Trace
from orchestrator.report.edges import KEY, with_edges
from orchestrator.report.lines import DECADES, band, line, log_axis
from orchestrator.report.making import page_for
from orchestrator.report.page import write_page
from orchestrator.report.tracking import error_axis
from orchestrator.run import run_topology
from orchestrator.run_directory import make_run_directory
from orchestrator.topology.load import load_topology
from tests.orchestrator.report.looking import look_at

GROWING = """
import numpy as np
from nodes.contract import Belief

class Growing:
    rounds = 0
    def __init__(self, setting):
        self.x = setting.plant.initial_mean + 1.0
    def correct(self, step, packets):
        self.x = 3.0 * self.x
    def exchange(self, step, round_, packets): ...
    def estimate(self, step):
        return Belief(state=self.x, covariance=np.eye(self.x.size))
"""
DIVERGING = """
name: diverging
steps: 60
period_s: 0.5
plant: {model: constant_acceleration, process_noise: {std: 0.2}, initial: {std: 1.0}}
sensors: {s1: {model: linear, C: [[1.0, 0.0, 0.0]], noise: {std: 0.1}}}
estimators:
  good: {method: kalman, sensors: [s1]}
  bad1: {method: "./growing.py:Growing", sensors: [s1]}
  bad2: {method: "./growing.py:Growing", sensors: [s1]}
"""


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Page:
    """The report of a run in which two of three estimators diverge to 1e28."""
    home = tmp_path_factory.mktemp("diverging")
    (home / "growing.py").write_text(GROWING)
    (home / "diverging.yaml").write_text(DIVERGING)
    topology = load_topology(home / "diverging.yaml")
    directory = make_run_directory(home / "out", "diverging", 1)
    run_topology(topology, directory, "inprocess", lambda recorded: None)
    return page_for([directory])


def named(page: Page, name: str) -> Figure:
    return next(figure for figure in page.figures if figure.name == name)


def shown(values: Any, axis: dict[str, Any]) -> list[bool]:
    low, high = axis["range"]
    return [bool(low <= np.log10(value) <= high) for value in values if value > 0]


def of(traces: list[Trace], name: str) -> Trace:
    return next(trace for trace in traces if trace["name"] == name)


def test_one_huge_value_does_not_push_all_others_off_the_axis() -> None:
    values = np.array([0.8, 1.2, 2.0, 30.0, 3.3e60])
    axis = log_axis("v", [values])
    assert shown(values, axis) == [True, True, True, True, False]
    assert axis["range"][1] - axis["range"][0] == pytest.approx(DECADES, abs=0.5)
    assert len(axis["tickvals"]) >= 4


def test_what_an_axis_is_anchored_at_is_seen_however_far_most_values_are_from_it() -> None:
    one, values = np.array([1.0]), np.array([1e20, 1e30, 1e40, 3.0])
    assert shown([1.0, 3.0], log_axis("v", [one, values], anchor=one)) == [True, True]


def test_an_axis_that_spans_few_decades_shows_everything() -> None:
    values = np.array([1e-3, 1.0, 1e5])
    assert all(shown(values, log_axis("v", [values], anchor=np.array([1e5]))))


def test_points_beyond_an_axis_stand_at_its_edge_with_their_true_value() -> None:
    drawn = line(np.arange(4), np.array([1.0, 1e30, 0.0, np.nan]), "d", "$blue")
    axis = {"type": "log", "range": [-2.0, 3.0]}
    _, edge, key = with_edges([drawn], {"yaxis": axis})
    assert edge["x"].tolist() == [1, 2]
    assert edge["customdata"] == ["1e+30", "0"]
    assert edge["marker"]["symbol"] == ["arrow-bar-up", "arrow-bar-down"]
    assert all(shown(edge["y"], axis))
    assert edge["legendgroup"] == "d"
    assert key["name"] == KEY


def test_a_band_and_an_axis_that_is_not_cut_have_no_edge() -> None:
    x, y = np.arange(2), np.array([1.0, 1e30])
    wide = band(x, y, 2.0 * y, "b", "$blue")
    log = {"type": "log", "range": [-2.0, 3.0]}
    assert with_edges([wide], {"yaxis": log}) == [wide]
    drawn = line(x, y, "d", "$blue", yaxis="y2")
    assert with_edges([drawn], {"yaxis": log, "yaxis2": {"type": "log"}}) == [drawn]
    assert with_edges([drawn], {"yaxis": log, "yaxis2": {"range": [0, 1]}}) == [drawn]


def test_good_estimators_are_not_on_the_floor_beside_bad_ones_that_did_not_diverge() -> None:
    alive = np.ones((2, 50), dtype=bool)
    good, bad = np.linspace(0.01, 0.04, 50), np.linspace(80.0, 120.0, 50)
    axis = error_axis("state", np.array([good, bad]), alive)
    assert all(shown([*good, *bad], axis))
    assert "type" not in error_axis("state", np.array([bad, bad / 3.0]), alive)


def test_a_healthy_estimator_is_seen_beside_diverging_ones(page: Page) -> None:
    figure = named(page, "errors")
    for view in figure.views.values():
        own = of(list(view.traces), "good")
        assert np.mean(shown(own["y"], view.layout["yaxis"])) > 0.9
        edges = with_edges(view.traces, {**figure.layout, **view.layout})
        assert {trace["name"] for trace in edges[len(view.traces) :]} >= {"bad1", "bad2", KEY}


def test_the_consistency_band_is_seen_though_an_estimator_diverges(page: Page) -> None:
    for view in named(page, "consistency").views.values():
        wide = view.traces[0]
        assert "fill" in wide
        assert all(shown(wide["y"], view.layout["yaxis"]))
    summary = named(page, "consistency-summary")
    assert shown([1.0], summary.layout["yaxis"]) == [True]


def test_every_estimator_has_a_point_in_the_browser_and_pointing_at_one_beyond_tells_it(
    page: Page, tmp_path: Path, browser: Any
) -> None:
    write_page(page, tmp_path / "page.html")
    with look_at(browser, tmp_path / "page.html", width=1280, scheme="light") as look:
        assert look.complaints == []
        figure = look.page.locator("#figure-consistency-summary")
        frame = figure.locator(".nsewdrag").bounding_box()
        boxes = [point.bounding_box() for point in figure.locator(".scatterlayer .point").all()]
        assert frame is not None
        inside = [
            box for box in boxes if box and 0.0 < box["y"] + box["height"] / 2 - frame["y"] < frame["height"]
        ]
        assert len(inside) == 4, "NEES of three estimators, and NIS of one"
        figure.scroll_into_view_if_needed()
        box = figure.locator(".scatterlayer .point").last.bounding_box()
        assert box is not None
        look.page.mouse.move(box["x"] + box["width"] / 2, box["y"] + 12)
        look.page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        label = figure.locator(".hoverlayer .hovertext")
        label.wait_for(timeout=10_000)
        assert "beyond the axis" in (label.text_content() or "")
