"""What a test asks for, checked: which seeds, which overrides, how many steps."""

from __future__ import annotations

import operator
from collections import Counter
from collections.abc import Iterable
from typing import Any

from orchestrator.topology.document import LARGEST_INTEGER

_CURE = "give whole numbers, as in seeds=range(20) or seeds=[3, 5]"


def read_seeds(given: Any) -> tuple[int, ...]:
    """Return the seeds that are asked for.

    Raises
    ------
    TypeError
        They are no collection of whole numbers.
    ValueError
        There is none, one is out of range, or one is there twice: its trials would not be independent.
    """
    if isinstance(given, (str, bytes)) or not isinstance(given, Iterable):
        raise TypeError(f"seeds={given!r} is {_what(given)}, not several seeds; {_CURE}")
    seeds = tuple(_read_seed(seed) for seed in given)
    if not seeds:
        raise ValueError("there are no seeds to run; give at least one, as in seeds=range(20)")
    repeated = [f"{seed} ({times} times)" for seed, times in Counter(seeds).items() if times > 1]
    if repeated:
        raise ValueError(
            f"seeds repeats {', '.join(repeated[:5])}{', ...' if len(repeated) > 5 else ''}; "
            "give each once: the same seed is the same run, and no further evidence"
        )
    return seeds


def read_steps(given: Any) -> int:
    """Return a number of steps; raises TypeError or ValueError when it is no whole number from 0."""
    steps = _whole(given, f"steps={given!r} is {_what(given)}, which is no whole number; give steps from 0")
    if steps < 0:
        raise ValueError(f"steps={steps} is negative; give steps from 0")
    return steps


def _whole(given: Any, complaint: str) -> int:
    try:
        if isinstance(given, bool):
            raise TypeError
        return operator.index(given)
    except TypeError:
        raise TypeError(complaint) from None


def _read_seed(given: Any) -> int:
    seed = _whole(given, f"seeds holds {given!r}, {_what(given)}, which is no whole number; {_CURE}")
    if not 0 <= seed <= LARGEST_INTEGER:
        problem = "negative" if seed < 0 else "too large"
        raise ValueError(f"seed {seed} is {problem}; give whole numbers from 0 to 2^53 ({LARGEST_INTEGER})")
    return seed


def read_overrides(given: Any) -> tuple[str, ...]:
    """Return the overrides that are asked for; raises TypeError when they are no collection of text."""
    cure = 'give a list of them, as in overrides=["steps=50"]'
    if isinstance(given, (str, bytes)) or not isinstance(given, Iterable):
        raise TypeError(f"overrides={given!r} is {_what(given)}, not several overrides; {cure}")
    overrides = tuple(given)
    for override in overrides:
        if not isinstance(override, str):
            raise TypeError(f"overrides holds {override!r}, {_what(override)}, which is no text; {cure}")
    return overrides


def _what(value: object) -> str:
    name = type(value).__name__
    return f"{'an' if name[0] in 'aeiou' else 'a'} {name}"
