"""The page as a file: whole, offline, small, always the same; looked at without a browser."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from orchestrator.report.contents import Figure, Page, Section, Table, Text, Tile, View
from orchestrator.report.lines import band, line
from orchestrator.report.making import page_for
from orchestrator.report.page import html, write_page
from orchestrator.report.run_report import verdict_table
from orchestrator.report.tracking import lines_range
from orchestrator.run import run_topology
from orchestrator.run_directory import make_run_directory
from orchestrator.topology.load import load_topology
from tests.orchestrator.report.conftest import ATTACKED
from tests.playing import scored

pytest.importorskip("plotly", reason="reports are an extra")
pytest.importorskip("jinja2", reason="reports are an extra")

LARGEST_BYTES = 12_000_000
ALONE = """
name: alone
steps: 20
period_s: 0.1
plant: {model: linear, A: [[0.9]], process_noise: {std: 0.1}, initial: {std: 1.0}}
sensors: {s1..s4: {model: linear, C: [[1.0]], noise: {std: 0.1}}}
estimators:
  e1: {method: kalman, sensors: [s1]}
  e2: {method: kalman, sensors: [s2]}
  e3: {method: kalman, sensors: [s3]}
  e4: {method: kalman, sensors: [s4]}
"""
VOID = {"meta", "link", "br", "input", "img", "hr"}


class _Reader(HTMLParser):
    """Reads a page: its elements, and whether each that was opened was closed."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.faults: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if not self.open or self.open.pop() != tag:
            self.faults.append(tag)

    def having(self, attribute: str) -> list[str]:
        return [str(attrs[attribute]) for _, attrs in self.elements if attribute in attrs]


def read(text: str) -> _Reader:
    reader = _Reader()
    reader.feed(text)
    return reader


@pytest.fixture(scope="module")
def text(run_file: Path) -> str:
    return run_file.read_text()


def test_the_page_is_well_formed_and_every_reference_leads_inside_it(text: str) -> None:
    reader = read(text)
    assert reader.faults == []
    assert reader.open == []
    names = reader.having("id")
    assert len(names) == len(set(names))
    assert {target.removeprefix("#") for target in reader.having("href")} <= set(names)
    assert reader.having("src") == []
    for attribute in ("aria-labelledby", "aria-describedby"):
        assert set(reader.having(attribute)) <= set(names)


def test_the_page_forbids_itself_every_request_and_carries_plotly_once(text: str) -> None:
    policy = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"
    assert f'content="{policy}"' in text
    assert len(re.findall(r"\* plotly\.js v", text)) == 1
    assert len(text.encode()) < LARGEST_BYTES


def test_the_page_tells_verdict_failed_expectation_and_origin(text: str) -> None:
    assert "<strong>FAILED</strong> 1 of 2 expectations failed (rmse.position)" in text
    assert '<span class="mark bad">failed</span>' in text
    assert '<span class="mark good">held</span>' in text
    for fact in ("topology hash", "version", "commit", "seed, trial"):
        assert fact in text


def test_an_expectation_tells_where_it_was_held_and_of_how_many_that_was_the_worst(tmp_path: Path) -> None:
    (tmp_path / "attacked.yaml").write_text(ATTACKED)
    expect = "{rmse.position: {at_most: 9}, packets.attacked: 18, attack.rmse: {node: e1, at_most: 1}}"
    topology = load_topology(tmp_path / "attacked.yaml", [f"expect={expect}"])
    where = {row[1]: row[-1] for row in verdict_table(scored(topology)).rows}
    assert re.fullmatch(r"(e[123]|lone), worst of 4", where["rmse.position"])
    assert where["packets.attacked"] == "all links"
    assert where["attack.rmse"].startswith("undefined for e1, ")


@pytest.fixture(scope="module")
def page(attacked_run: Path) -> Page:
    return page_for([attacked_run])


def test_every_part_that_a_run_has_is_there(page: Page) -> None:
    assert [section.title for section in page.sections] == [
        *("Verdicts", "Network", "Truth and estimates", "Errors", "Consistency", "Detection"),
        *("Communication", "Provenance"),
    ]
    assert [figure.name for figure in page.figures] == [
        *("network", "tracking", "errors", "disagreement", "consistency-summary", "consistency"),
        *("detection", "roc", "traffic", "links"),
    ]


def test_estimators_that_are_each_alone_are_called_no_network(page: Page, tmp_path: Path) -> None:
    def disagreement(page: Page) -> Figure:
        return next(own for own in page.figures if own.name == "disagreement")

    assert disagreement(page).text.endswith(
        "of each network, or of estimators of one method that are each alone."
    )
    assert [trace["name"] for trace in disagreement(page).initial.traces] == ["e1 to e3"]
    (tmp_path / "alone.yaml").write_text(ALONE)
    topology = load_topology(tmp_path / "alone.yaml")
    directory = make_run_directory(tmp_path / "out", "alone", 1)
    run_topology(topology, directory, "inprocess", lambda recorded: None)
    alone = page_for([directory])
    assert alone.headline == "The estimators e1..e4, each alone, kept tracking; nothing was expected of it."
    assert disagreement(alone).text.endswith("the estimators of one method, each of them alone.")
    assert [trace["name"] for trace in disagreement(alone).initial.traces] == ["e1 to e4, each alone"]


def test_the_same_run_gives_the_same_bytes(attacked_run: Path, run_file: Path, tmp_path: Path) -> None:
    write_page(page_for([attacked_run]), tmp_path / "again.html")
    assert (tmp_path / "again.html").read_bytes() == run_file.read_bytes()


def test_every_figure_is_one_that_plotly_takes(page: Page) -> None:
    from plotly.graph_objects import Figure as Checked

    from orchestrator.report.palette import DARK, LIGHT
    from orchestrator.report.payload import plotly_figure

    for figure in page.figures:
        for key, view in figure.views.items():
            for palette in (LIGHT, DARK) if view is figure.initial else (LIGHT,):
                drawn = plotly_figure(figure, view, palette)
                Checked(drawn)
                assert "$" not in str(drawn), f"{figure.name} {key} keeps a colour that no palette has"


def test_what_a_page_is_told_can_do_no_harm() -> None:
    nasty = "</script><script>alert(1)</script>"
    page = Page(
        title=nasty,
        kind="Run report",
        word="DONE",
        tone="plain",
        headline=nasty,
        facts=nasty,
        tiles=[Tile(nasty, nasty)],
        sections=[
            Section(
                "one",
                nasty,
                [
                    Text(nasty),
                    Table(nasty, [nasty], [[nasty]]),
                    Figure("f", nasty, {(): View([{"type": "scatter", "x": [1], "y": [1], "name": nasty}])}),
                ],
            )
        ],
    )
    reader = read(html(page))
    assert reader.faults == []
    assert [tag for tag, _ in reader.elements].count("script") == 5


def test_a_band_that_would_hide_the_lines_is_cut_and_others_are_not() -> None:
    x = np.arange(50)
    y = np.sin(x)

    def shown(width: float, at: int | None = None) -> dict[str, Any]:
        reach = np.full(50, width) if at is None else np.where(x == at, width, 0.1)
        return lines_range([band(x, y - reach, y + reach, "b", "$blue"), line(x, y, "l", "$ink")])

    assert shown(0.2) == {}
    assert shown(12.0) == {}, "an estimator that is too careful shows its whole band"
    low, high = shown(1e30, at=7)["range"]
    assert low < -1.0 < 1.0 < high
    assert high - low < 10.0


@pytest.mark.slow
def test_a_long_run_makes_a_small_page_that_says_what_was_thinned(tmp_path: Path) -> None:
    (tmp_path / "long.yaml").write_text(ATTACKED)
    topology = load_topology(tmp_path / "long.yaml", ["steps=8000", "expect=null"])
    directory = make_run_directory(tmp_path / "out", "long", 7)
    run_topology(topology, directory, "inprocess", lambda recorded: None)
    page = page_for([directory])
    assert write_page(page, tmp_path / "long.html") < LARGEST_BYTES
    assert any("of 8,000 steps about 2,000 a line are drawn" in note for note in page.notes)
