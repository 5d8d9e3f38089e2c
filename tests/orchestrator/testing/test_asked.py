"""What a test may ask for: seeds and overrides that cannot be meant are refused with their cure."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

from orchestrator.testing.asked import read_overrides, read_seeds


def test_whole_numbers_of_any_type_are_seeds() -> None:
    for given in (range(3), [0, 1, 2], np.arange(3), (number for number in (0, 1, 2))):
        seeds = read_seeds(given)
        assert seeds == (0, 1, 2)
        assert {type(seed) for seed in seeds} == {int}
    assert read_seeds([2**53, 0]) == (2**53, 0)


@pytest.mark.parametrize(
    ("given", "error", "words"),
    [
        (5, TypeError, "seeds=5 is an int, not several seeds"),
        (np.int64(5), TypeError, "is an int64, not several seeds"),
        (1.5, TypeError, "seeds=1.5 is a float, not several seeds"),
        ("123", TypeError, "seeds='123' is a str, not several seeds"),
        (b"123", TypeError, "seeds=b'123' is a bytes, not several seeds"),
        ([1.5], TypeError, "seeds holds 1.5, a float, which is no whole number"),
        ([3, "4"], TypeError, "seeds holds '4', a str, which is no whole number"),
        (np.linspace(0, 3, 4), TypeError, "a float64, which is no whole number"),
        ([True], TypeError, "seeds holds True, a bool, which is no whole number"),
        ([None], TypeError, "seeds holds None, a NoneType, which is no whole number"),
        (range(0), ValueError, "there are no seeds to run; give at least one"),
        ([3, -1], ValueError, "seed -1 is negative; give whole numbers from 0"),
        ([2**70], ValueError, f"seed {2**70} is too large; give whole numbers from 0 to 2^53"),
        ([2**53 + 1], ValueError, f"seed {2**53 + 1} is too large"),
        (
            [0] * 3 + [1] * 200 + [2],
            ValueError,
            "seeds repeats 0 (3 times), 1 (200 times); give each once: the same seed is the same run",
        ),
    ],
)
def test_seeds_that_cannot_be_meant_are_refused(given: Any, error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=re.escape(words)):
        read_seeds(given)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ("steps=50", "overrides='steps=50' is a str, not several overrides; give a list of them"),
        (3, "overrides=3 is an int, not several overrides"),
        (["steps=50", 3], "overrides holds 3, an int, which is no text"),
    ],
)
def test_overrides_that_cannot_be_meant_are_refused(given: Any, words: str) -> None:
    assert read_overrides(own for own in ["steps=50"]) == ("steps=50",)
    with pytest.raises(TypeError, match=re.escape(words)):
        read_overrides(given)
