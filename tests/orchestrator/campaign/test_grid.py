from __future__ import annotations

import pytest

from orchestrator.campaign.grid import GridError, lay_grid
from orchestrator.topology.value_lists import split_values


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("0.05,0.1, 0.3", ["0.05", "0.1", "0.3"]),
        ("[1,2],[3,4]", ["[1,2]", "[3,4]"]),
        ("{a: [1, 2], b: 'x,y'},null", ["{a: [1, 2], b: 'x,y'}", "null"]),
        ("'a,b',\"c,d\"", ["'a,b'", '"c,d"']),
        ("{a: '}'},2", ["{a: '}'}", "2"]),
        ("the plant's own,mine", ["the plant's own", "mine"]),
        ("[10, 20]", ["[10, 20]"]),
    ],
)
def test_values_are_split_at_commas_outside_of_brackets_and_quotes(text: str, values: list[str]) -> None:
    assert split_values(text) == values


def test_a_grid_is_every_combination_and_the_first_path_varies_slowest() -> None:
    variants = lay_grid(["steps=5", "a.b=1,2", "seed=3", "c=x,y"])
    assert [variant.settings for variant in variants] == [
        {"a.b": "1", "c": "x"},
        {"a.b": "1", "c": "y"},
        {"a.b": "2", "c": "x"},
        {"a.b": "2", "c": "y"},
    ]
    assert variants[3].overrides == ("steps=5", "a.b=2", "seed=3", "c=y")
    assert [variant.number for variant in variants] == [0, 1, 2, 3]


def test_without_several_values_there_is_one_variant() -> None:
    (variant,) = lay_grid(["steps=5"])
    assert (dict(variant.settings), variant.overrides) == ({}, ("steps=5",))


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (["trial=1,2"], "trials are no variants"),
        (["trial=3"], "trials are no variants"),
        (["a=1,,2"], "a value is empty"),
        (["a=1,2", "a=3,4"], "has several values already"),
        (["a=1,1"], "is there twice"),
        (["a=1,2", "a=3"], "overrides all the values"),
        ([f"{path}=" + ",".join(map(str, range(30))) for path in "abc"], "27000 variants"),
    ],
)
def test_a_grid_that_makes_no_sense_is_refused(overrides: list[str], message: str) -> None:
    with pytest.raises(GridError, match=message):
        lay_grid(overrides)
