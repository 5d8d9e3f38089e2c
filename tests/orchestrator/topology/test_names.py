"""Names, ranges and patterns."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orchestrator.topology.names import NodeNameError, expand, matches, select, split_number

PREFIX = st.from_regex(r"[a-z]{2}[a-z_-]{0,5}_", fullmatch=True)


@given(PREFIX, st.integers(0, 500), st.integers(0, 40))
def test_a_range_holds_both_ends_and_all_between(prefix: str, first: int, more: int) -> None:
    names = expand(f"{prefix}{first}..{prefix}{first + more}")
    assert names == [f"{prefix}{number}" for number in range(first, first + more + 1)]


@given(PREFIX, st.integers(1, 500), st.integers(1, 40))
def test_a_backward_range_is_refused_with_the_right_one(prefix: str, first: int, more: int) -> None:
    with pytest.raises(NodeNameError) as caught:
        expand(f"{prefix}{first + more}..{prefix}{first}")
    assert caught.value.cure == f"write {prefix}{first}..{prefix}{first + more}"


@given(PREFIX, st.integers(0, 10**6))
def test_a_name_splits_into_family_and_number(prefix: str, number: int) -> None:
    assert split_number(f"{prefix}{number}") == (prefix, number)


@pytest.mark.parametrize(
    "name", ["a/b", "a*", "a$b", "#a", "a?", "", "1a", "a b", "ä", "a.b", "a->b", "Plant", "all"]
)
def test_what_the_bus_or_the_file_would_misread_is_no_name(name: str) -> None:
    with pytest.raises(NodeNameError):
        expand(name)


@pytest.mark.parametrize(
    ("pattern", "name", "fits"),
    [
        ("e*", "e12", True),
        ("e*", "f1", False),
        ("*", "anything", True),
        ("e1..e9", "e5", True),
        ("e1..e9", "e10", False),
        ("e1", "e1", True),
        ("e1", "e12", False),
        ("e[12]", "e1", False),
        ("e?", "e1", False),
    ],
)
def test_a_pattern_is_a_name_a_range_or_has_stars(pattern: str, name: str, fits: bool) -> None:
    assert matches(pattern, name) is fits
    assert select(pattern, [name]) == ([name] if fits else [])
