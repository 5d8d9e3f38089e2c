"""The page in a headless Chromium: it draws, asks for nothing, and can be read and used."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.orchestrator.report.looking import Look

pytest.importorskip("plotly", reason="reports are an extra")
pytest.importorskip("jinja2", reason="reports are an extra")


@pytest.mark.parametrize("screen", ["wide", "narrow"])
def test_the_page_draws_every_figure_and_asks_the_network_for_nothing(
    request: pytest.FixtureRequest, screen: str, run_file: Path
) -> None:
    look: Look = request.getfixturevalue(screen)
    assert look.complaints == []
    assert look.requests == [run_file.as_uri()]
    assert look.page.locator("figure").count() >= 9
    assert look.empty_plots() == []


@pytest.mark.parametrize("screen", ["wide", "narrow"])
def test_nothing_is_cut_off_and_all_text_can_be_read(request: pytest.FixtureRequest, screen: str) -> None:
    look: Look = request.getfixturevalue(screen)
    assert look.overflow() <= 0
    assert look.smallest_text() >= 10.0
    for plot in look.page.locator(".plot").all():
        box = plot.bounding_box()
        assert box is not None
        assert box["width"] >= 300
        assert box["height"] >= 200


def test_pointing_at_a_node_tells_its_figures(wide: Look) -> None:
    network = wide.page.locator("#figure-network")
    network.scroll_into_view_if_needed()
    place = wide.page.evaluate("""() => {
        const plot = document.querySelector("#figure-network .plot");
        const trace = plot.data.find(t => t.name === "estimator");
        const { xaxis, yaxis } = plot._fullLayout;
        const { left, top } = plot.getBoundingClientRect();
        const [x, y] = [xaxis.d2p(trace.x[1]), yaxis.d2p(trace.y[1])];
        return [left + xaxis._offset + x, top + yaxis._offset + y];
    }""")
    wide.page.mouse.move(place[0] - 3, place[1] - 2)
    wide.page.mouse.move(*place)
    label = network.locator(".hoverlayer .hovertext")
    label.wait_for(timeout=10_000)
    told = label.text_content() or ""
    assert "e2" in told
    assert "RMSE: position" in told
    assert "attacked in 12 steps" in told


def test_pointing_at_a_time_series_tells_truth_and_estimate(wide: Look) -> None:
    figure = wide.page.locator("#figure-tracking")
    figure.scroll_into_view_if_needed()
    box = figure.locator(".plot").bounding_box()
    assert box is not None
    wide.page.mouse.move(box["x"] + box["width"] / 2, box["y"] + 80)
    wide.page.mouse.move(box["x"] + box["width"] / 2 + 4, box["y"] + 84)
    label = figure.locator(".hoverlayer .legend, .hoverlayer .hovertext").first
    label.wait_for(timeout=10_000)
    told = figure.locator(".hoverlayer").text_content() or ""
    assert "truth" in told
    assert "estimate" in told


def test_a_key_of_the_legend_switches_its_line_off_and_on_again_by_keyboard(wide: Look) -> None:
    figure = wide.page.locator("#figure-errors")
    drawn = figure.locator(".scatterlayer .trace")
    before = drawn.count()
    key = figure.locator(".legend button", has_text="lone")
    assert key.get_attribute("aria-pressed") == "true"
    key.focus()
    wide.page.keyboard.press("Enter")
    assert key.get_attribute("aria-pressed") == "false"
    assert drawn.count() == before - 1
    wide.page.keyboard.press("Enter")
    assert drawn.count() == before


def test_choosing_another_estimator_and_component_shows_its_values(wide: Look) -> None:
    figure = wide.page.locator("#figure-tracking")
    values = "document.querySelector('#figure-tracking .plot').data.find(t => t.name === 'estimate').y[30]"
    first = wide.page.evaluate(values)
    figure.locator("select").nth(0).select_option("lone")
    other = wide.page.evaluate(values)
    figure.locator("select").nth(1).select_option(label="velocity")
    velocity = wide.page.evaluate(values)
    assert len({first, other, velocity}) == 3
    assert figure.locator(".ytitle").text_content() == "velocity"


def test_the_theme_button_turns_page_and_figures_dark_and_back(wide: Look) -> None:
    colours = """() => [getComputedStyle(document.body).backgroundColor,
        getComputedStyle(document.querySelector('#figure-errors .xtick text')).fill]"""
    light = wide.page.evaluate(colours)
    button = wide.page.locator("#theme")
    button.click()
    assert button.get_attribute("aria-pressed") == "true"
    wide.page.wait_for_function(f"({colours})()[1] !== '{light[1]}'", timeout=10_000)
    assert wide.page.evaluate(colours)[0] == "rgb(20, 25, 31)"
    button.click()
    wide.page.wait_for_function(f"({colours})()[1] === '{light[1]}'", timeout=10_000)
    assert wide.page.evaluate(colours) == light


def test_a_reader_who_prefers_dark_gets_a_dark_page(narrow: Look) -> None:
    assert narrow.page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(20, 25, 31)"
    assert narrow.page.evaluate("document.documentElement.dataset.theme") == "dark"
    assert _contrast(narrow, "#figure-errors .xtick text") > 7.0


def _contrast(look: Look, selector: str) -> float:
    """Return the contrast (WCAG) of a drawn text with the page."""
    ratio: float = look.page.evaluate(
        """selector => {
        const light = text => text.match(/[\\d.]+/g).slice(0, 3).map(Number).map(v => v / 255)
            .map(v => v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4)
            .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
        const ink = light(getComputedStyle(document.querySelector(selector)).fill);
        const paper = light(getComputedStyle(document.body).backgroundColor);
        return (Math.max(ink, paper) + 0.05) / (Math.min(ink, paper) + 0.05);
    }""",
        selector,
    )
    return ratio
