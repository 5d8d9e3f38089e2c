"""A page of a grid with twins: what they do not spoil, what is told once, and two swept numbers in a map."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from orchestrator.campaign.sweep import Request, prepare, sweep
from orchestrator.command_line.campaign_output import QuietProgress
from orchestrator.evidence.chosen import choose
from orchestrator.evidence.figures import rmse
from orchestrator.report.contents import Figure, Page, Table
from orchestrator.report.grouping import find_groups
from orchestrator.report.making import page_for
from orchestrator.report.page import write_page
from tests.orchestrator.report.conftest import SWEPT
from tests.orchestrator.report.looking import look_at

if TYPE_CHECKING:
    from playwright.sync_api import Browser

pytest.importorskip("plotly", reason="reports are an extra")
pytest.importorskip("jinja2", reason="reports are an extra")
pytest.importorskip("pyarrow", reason="campaigns are an extra")

VALUE, THRESHOLD = "attacks.0.bias.value", "estimators.strict.threshold"


@pytest.fixture(scope="module")
def grid(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The directory of a campaign over a bias and a threshold, with twins that the bias does not change."""
    home = tmp_path_factory.mktemp("grid")
    (home / "grid.yaml").write_text(SWEPT + "  packets.attacked: 6\n")
    overrides = (f"{VALUE}=1,4", f"{THRESHOLD}=4,9,16")
    request = Request(home / "grid.yaml", 2, overrides=overrides, out=home / "out", twins=True)
    return sweep(prepare(request), QuietProgress())


@pytest.fixture(scope="module")
def page(grid: Path) -> Page:
    """The report of it."""
    return page_for([grid])


def figure(page: Page, name: str) -> Figure:
    """Return a figure of a page."""
    return next(own for own in page.figures if own.name == name)


def table(page: Page, title: str) -> Table:
    """Return the table of a page whose caption begins so."""
    blocks = [block for section in page.sections for block in section.blocks]
    return next(own for own in blocks if isinstance(own, Table) and own.caption.startswith(title))


def test_twins_count_neither_as_passed_nor_as_failed(page: Page) -> None:
    assert page.headline.startswith("All that was expected held in 12 of 12 attacked trials; ")
    (passed,) = (tile for tile in page.tiles if tile.name == "Passed")
    assert (passed.value, passed.remark) == ("100 %", "12 of 12; 6 of twins do not count")
    column = table(page, "Variants").columns.index("passed")
    for row in table(page, "Variants").rows:
        assert (row[column] == "-") == ("attacks null" in row[1])
    labels = {name for trace in figure(page, "outcomes").initial.traces for name in trace["customdata"]}
    assert not any("attacks null" in name for name in labels)


def test_an_unattacked_twin_is_never_called_the_best(grid: Path, page: Page) -> None:
    groups = find_groups([choose(grid)], None, [])
    least = min(groups, key=lambda group: rmse(group.rows, "position").value)
    best = min(
        (group for group in groups if not group.is_twin), key=lambda group: rmse(group.rows, "position").value
    )
    assert least.is_twin or least is best
    assert f"The smallest RMSE of position is that of {best.name}: " in page.headline


def test_twins_alone_are_held_to_what_is_expected_of_them(grid: Path) -> None:
    alone = page_for([f"{grid}#attacks=null"])
    assert alone.headline.startswith("All that was expected held in 0 of 6 trials; ")


def test_variants_that_ran_the_same_topology_are_told_of_once(grid: Path, page: Page) -> None:
    names = [row[1] for row in table(page, "Variants").rows]
    twins = [name for name in names if "attacks null" in name]
    assert twins == [
        f"threshold {threshold}, attacks null, {part}"
        for threshold in ("4", "9", "16")
        for part in ("secure_distributed", "kalman lone", "kalman strict")
    ]
    assert len(names) == 27, "six attacked variants and three twins, each of three kinds"
    assert page.notes[0] == (
        "3 of 12 variants ran the very topology of another one, in which what sets them apart changes "
        "nothing, and are told of with it, by number: 7 as 1; 9 as 3; 11 as 5."
    )
    prices = table(page, "Price of the attack in rmse.position").rows
    assert len(prices) == 18, "each attacked group has its twin all the same"


def test_a_variant_told_of_with_another_is_there_when_it_is_asked_for(grid: Path) -> None:
    alone = page_for([f"{grid}#{VALUE}=4,attacks=null"])
    assert table(alone, "Variants").rows[0][1] == "value 4, threshold 4, attacks null, secure_distributed"
    assert not any("very topology" in note for note in alone.notes)


def test_the_curves_seen_first_are_those_that_err_least_under_attack(grid: Path, page: Page) -> None:
    groups = {group.name: group for group in find_groups([choose(grid)], None, [])}
    curves = [trace for trace in figure(page, "rmse").initial.traces if "fill" not in trace]
    seen = {
        trace["name"] for trace in curves if trace.get("visible", True) is True and trace["name"] in groups
    }
    assert len(seen) == 8
    attacked = {name: own for name, own in groups.items() if not own.is_twin}
    best = sorted(attacked, key=lambda name: rmse(attacked[name].rows, "position").value)[:8]
    worst_seen = max(rmse(groups[name].rows, "position").value for name in seen)
    assert worst_seen == pytest.approx(rmse(groups[best[-1]].rows, "position").value)
    assert seen <= set(attacked)


def test_many_long_names_are_numbers_on_axes_and_whole_beside_the_pointer(grid: Path, page: Page) -> None:
    boxes = figure(page, "trials")
    groups = find_groups([choose(grid)], None, [])
    assert [trace["y"][0] for trace in boxes.initial.traces] == [f"{group.number}" for group in groups]
    for trace, group in zip(boxes.initial.traces, groups, strict=True):
        assert trace["hovertemplate"].startswith(group.name)
    assert boxes.text.endswith("The numbers are those of the table of variants.")
    assert [row[:2] for row in table(page, "Variants").rows] == [(f"{g.number}", g.name) for g in groups]
    assert boxes.height < 30 * len(groups) + 150
    few = figure(page_for([f"{grid}#{VALUE}=4,{THRESHOLD}=9,attacks=null"]), "trials")
    assert few.initial.traces[0]["y"][0] == (
        "value 4,<br>threshold 9,<br>attacks null,<br>secure_distributed"
    )


def test_long_tables_wait_until_they_are_opened(page: Page) -> None:
    assert not table(page, "Variants").folded
    assert not table(page, "RMSE over all").folded
    assert table(page, "Price of the attack").folded
    assert table(page, "Consistency over all").folded


def test_two_swept_numbers_are_drawn_together_with_the_errors_of_the_table(grid: Path, page: Page) -> None:
    (own,) = (found for found in page.figures if found.name.startswith("swept-pair"))
    assert own.title == "RMSE over value and threshold"
    assert [text for _, text in own.choices[0].options] == [
        "attacks as given, secure_distributed",
        "attacks as given, kalman lone",
        "attacks as given, kalman strict",
    ]
    (trace,) = own.views["2", "position", "all"].traces
    assert (trace["x"], trace["y"]) == (["1", "4"], ["4", "9", "16"]), "ascending, the longer one down"
    errors = {row[0]: row[1] for row in table(page, "RMSE over all").rows}
    for i, threshold in enumerate(trace["y"]):
        for j, value in enumerate(trace["x"]):
            name = f"value {value}, threshold {threshold}, attacks as given, kalman strict"
            assert trace["customdata"][i][j] == errors[name]
            assert trace["z"][i][j] == pytest.approx(float(errors[name].split()[0]), rel=1e-3)


def test_one_swept_number_makes_no_map(grid: Path) -> None:
    page = page_for([f"{grid}#{VALUE}=4"])
    assert not any(own.name.startswith("swept-pair") for own in page.figures)


@pytest.mark.parametrize(("width", "scheme"), [(390, "dark"), (1280, "light")])
def test_the_map_of_two_numbers_can_be_read_on_any_screen(
    browser: Browser, page: Page, tmp_path: Path, width: int, scheme: str
) -> None:
    file = tmp_path / "report.html"
    write_page(page, file)
    with look_at(browser, file, width=width, scheme=scheme) as look:  # type: ignore[arg-type]
        assert look.complaints == []
        assert look.overflow() <= 0
        assert look.empty_plots() == []
        cells = look.page.locator("#figure-swept-pair .heatmap-label")
        texts = cells.all_inner_texts()
        assert len(texts) == 6, "each cell says its error"
        boxes = [cells.nth(i).bounding_box() for i in range(6)]
        assert all(box is not None and box["height"] >= 12 for box in boxes)
        rows = [
            sorted((b["x"], b["x"] + b["width"]) for b in boxes if b and abs(b["y"] - own["y"]) < 5)
            for own in boxes
            if own
        ]
        assert all(left[1] < right[0] for row in rows for left, right in pairwise(row))
