from __future__ import annotations

import pytest

from channel.attacks.series import Series

ROWS = [[1.0], [2.0]]


@pytest.mark.parametrize(
    ("after", "expected"),
    [("stop", [11, 12, 10, 10]), ("hold", [11, 12, 12, 12]), ("loop", [11, 12, 11, 12])],
)
def test_rows_are_added_from_the_first_step_of_the_window(placed, played, after, expected):
    attack = played(Series(placed(first=5), values=ROWS, after=after))
    assert [attack.says(step, 10.0)[0] for step in (5, 6, 7, 8)] == expected


def test_rows_can_replace_the_named_components(placed, played):
    attack = played(Series(placed(), values=[[7.0, 8.0]], replace=True, components=[2, 0]))
    assert attack.says(0, 1.0, 2.0, 3.0) == [8.0, 2.0, 7.0]


@pytest.mark.parametrize("values", [[], [[]], [[1.0], [1.0, 2.0]]])
def test_rows_of_no_or_of_different_lengths_are_refused(placed, values):
    with pytest.raises(ValueError, match="rows of one length"):
        Series(placed(), values=values)
