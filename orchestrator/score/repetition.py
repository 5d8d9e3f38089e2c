"""Whether a run that was repeated came out the same: which figures of two scores differ."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import msgspec

from orchestrator.score.results import Score

_NAMES_SHOWN = 6
_SPELLING = frozenset({"method", "line"})
"""What tells how a topology was written, not what its run came to: a log has it otherwise than a file."""


def differences(one: Score, other: Score) -> dict[str, tuple[object, object]]:
    """Return the figures in which two scores differ, by their names in ``score.json``, with both values.

    Equal runs differ in none: of a log and of memory, in one process or in many.
    """
    return dict(_differences(msgspec.to_builtins(one), msgspec.to_builtins(other), ""))


def _differences(one: Any, other: Any, name: str) -> Iterator[tuple[str, tuple[object, object]]]:
    if isinstance(one, Mapping) and isinstance(other, Mapping) and one.keys() == other.keys():
        for key in one:
            if key not in _SPELLING:
                yield from _differences(one[key], other[key], f"{name}.{key}" if name else str(key))
    elif isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        for place, (own, its) in enumerate(zip(one, other, strict=True)):
            label = own.get("name", place) if isinstance(own, Mapping) else place
            yield from _differences(own, its, f"{name}[{label}]")
    elif one != other:
        yield name, (one, other)


def shown(names: Sequence[str]) -> str:
    """Return the names of what differs, the first of them when they are many."""
    return ", ".join(names[:_NAMES_SHOWN]) + (", ..." if len(names) > _NAMES_SHOWN else "")
