"""Thinning, colours and the payload: the small parts of a page."""

from __future__ import annotations

import base64
import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from orchestrator.report.contents import Figure, View
from orchestrator.report.lines import band, stairs
from orchestrator.report.palette import DARK, LIGHT, colour, coloured
from orchestrator.report.payload import payload
from orchestrator.report.thinning import binned, kept, stretches_of


@given(st.lists(st.floats(-1e6, 1e6) | st.just(float("nan")), min_size=1, max_size=400), st.integers(6, 60))
def test_a_thinned_series_keeps_its_extremes_and_its_ends(values: list[float], most: int) -> None:
    series = np.array(values)
    at = kept(series, most)
    assert at.size <= max(most, 2)
    assert {0, series.size - 1} <= set(at.tolist())
    assert (np.diff(at) > 0).all()
    if np.isfinite(series).any():
        assert np.nanmax(series[at]) == np.nanmax(series)
        assert np.nanmin(series[at]) == np.nanmin(series)


def test_a_short_series_is_drawn_as_it_is() -> None:
    assert kept(np.arange(5.0), 5).tolist() == [0, 1, 2, 3, 4]


@given(st.lists(st.integers(0, 5), min_size=1, max_size=300), st.integers(1, 40))
def test_counts_in_stretches_lose_no_packet(counts: list[int], most: int) -> None:
    starts, sums, width = binned(np.array([counts]), most)
    assert sums.sum() == sum(counts)
    assert starts.size <= most
    assert sums[0, 0] == sum(counts[:width])


def test_runs_of_attacked_steps_are_joined_only_when_there_are_too_many() -> None:
    marks = np.zeros(1000, dtype=bool)
    marks[[3, 4, 5, 9]] = True
    assert stretches_of(marks) == [(3, 5), (9, 9)]
    marks[::2] = True
    joined = stretches_of(marks, most=10)
    assert len(joined) <= 10
    assert (joined[0][0], joined[-1][1]) == (0, 998)


def test_a_colour_is_what_the_palette_says_and_other_text_stays() -> None:
    assert colour("$attack", LIGHT) == LIGHT["attack"]
    assert colour("$attack/20", LIGHT) == "rgba(213,94,0,0.2)"
    assert colour("$nothing", LIGHT) == "$nothing"
    assert coloured({"a": ["$ink", 3, "5 $"]}, DARK) == {"a": [DARK["ink"], 3, "5 $"]}


@pytest.mark.parametrize("palette", [LIGHT, DARK])
def test_lines_stand_out_from_the_paper(palette: dict[str, str]) -> None:
    for name in ("ink", "muted", "attack", "blue", "green", "pink", "amber", "sky", "brown", "slate"):
        assert _contrast(palette[name], palette["paper"]) >= 3.0, name


def _contrast(one: str, other: str) -> float:
    """Return the contrast of two colours as WCAG 2 defines it."""

    def luminance(text: str) -> float:
        parts = np.array([int(text[at : at + 2], 16) for at in (1, 3, 5)]) / 255.0
        linear = np.where(parts <= 0.03928, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
        return float(linear @ [0.2126, 0.7152, 0.0722])

    high, low = sorted((luminance(one), luminance(other)), reverse=True)
    return (high + 0.05) / (low + 0.05)


def test_a_payload_holds_equal_arrays_once_and_numbers_in_single_precision() -> None:
    x, y = np.arange(3), np.array([0.5, np.nan, 2.0**60])
    trace = {"x": x, "y": y}
    figure = Figure("f", "F", {("a",): View([trace]), ("b",): View([{"x": x.copy(), "y": y[:2]}])})
    content = json.loads(payload([figure]))
    assert [packed["dtype"] for packed in content["arrays"]] == ["i2", "f4", "f4"]
    views = content["figures"][0]["views"]
    assert views["a"]["traces"][0]["x"] == views["b"]["traces"][0]["x"] == {"array": 0}
    back = np.frombuffer(base64.b64decode(content["arrays"][1]["bdata"]), dtype="<f4")
    assert back[0] == 0.5
    assert np.isnan(back[1])
    assert back[2] == 2.0**60


@pytest.mark.parametrize("value", [3.3e60, 1e-50])
def test_a_number_beyond_single_precision_reaches_the_page_as_it_is(value: float) -> None:
    trace = {"x": np.arange(3), "y": np.array([1.0, np.nan, value])}
    packed = json.loads(payload([Figure("f", "F", {(): View([trace])})]))["arrays"][1]
    back = np.frombuffer(base64.b64decode(packed["bdata"]), dtype=f"<{packed['dtype']}")
    assert back[2] == value


def test_a_band_has_gaps_where_its_edges_do_and_joins_nothing_over_them() -> None:
    low, high = np.array([0.0, 1.0, np.nan, 3.0, 4.0]), np.array([5.0, 6.0, 7.0, np.nan, 9.0])
    drawn = band(np.arange(5), low, high, "b", "$blue")
    assert drawn["x"].tolist() == pytest.approx([0, 1, 1, 0, np.nan, 4, 4], nan_ok=True)
    assert drawn["y"].tolist() == pytest.approx([0, 1, 6, 5, np.nan, 4, 9], nan_ok=True)
    assert band(np.arange(2), low[2:4], high[2:4], "b", "$blue")["x"].size == 0


def test_stairs_keep_each_value_until_the_next_begins() -> None:
    x, y = stairs(np.arange(3), np.array([1.0, 0.5, 0.2]))
    assert x.tolist() == [0, 1, 1, 2, 2]
    assert y.tolist() == [1.0, 1.0, 0.5, 0.5, 0.2]


def test_a_payload_cannot_end_its_script() -> None:
    figure = Figure("f", "F", {(): View([{"name": "</script>"}])})
    assert "<" not in payload([figure])
