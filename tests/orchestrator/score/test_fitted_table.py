"""Tables on narrow terminals: words fold and columns go, and say so; no figure is ever cut short."""

from __future__ import annotations

import io
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console, RenderableType

from orchestrator.score.fitted_table import Column, fit, fitted

COLUMNS = [
    Column("attacked link", words=True),
    Column("by", leave_out=1, words=True, folds_to=8),
    Column("rejected"),
    Column("false alarms", leave_out=2),
]
ROWS = [
    ["s1->e1", "covert@c1->plant,s1->e1", "0.00345", "1 of 12345"],
    ["s2->e2", "bias", "-1.05e-123", "-"],
]


def shown(renderable: RenderableType, width: int) -> list[str]:
    stream = io.StringIO()
    Console(file=stream, width=width).print(renderable)
    return stream.getvalue().splitlines()


def test_a_table_with_room_stands_as_it_is() -> None:
    lines = shown(fitted(COLUMNS, ROWS, 100), 100)
    assert lines[0].split("  ")[0] == "attacked link"
    assert "covert@c1->plant,s1->e1" in lines[2]
    assert len(lines) == 4


def test_words_fold_before_heads_break_and_heads_break_before_a_column_goes() -> None:
    natural = fit(COLUMNS, ROWS, 100).width
    folded = fit(COLUMNS, ROWS, natural - 5)
    assert (folded.left_out, folded.heads[0]) == ([], "attacked link")
    assert folded.width == natural - 5
    broken = fit(COLUMNS, ROWS, natural - 20)
    assert (broken.left_out, broken.heads[0]) == ([], "attacked\nlink")
    assert fit(COLUMNS, ROWS, 35).left_out == ["false alarms"]
    assert fit(COLUMNS, ROWS, 22).left_out == ["by", "false alarms"]


@given(st.integers(20, 100))
def test_every_figure_is_whole_and_what_is_left_out_is_named(width: int) -> None:
    lines = shown(fitted(COLUMNS, ROWS, width, more=3), width)
    text = "\n".join(lines)
    assert max(map(len, lines)) <= width
    assert "…" not in text
    assert "0.00345" in text
    assert "-1.05e-123" in text
    assert "and 3 more" in text
    named = re.search(r"\(no room for: ([^)]*)\)", text)
    left_out = " ".join(named[1].split()) if named else ""
    assert ("1 of 12345" in text) is ("false alarms" not in left_out)


@pytest.mark.parametrize("width", [1, 5])
def test_no_width_is_too_small_to_print_at_all(width: int) -> None:
    assert shown(fitted(COLUMNS, ROWS, width), width)
