"""Node names, inclusive ranges ``s1..s20``, and patterns ``e*``."""

from __future__ import annotations

import re
from collections.abc import Iterable
from fnmatch import fnmatchcase

NODE_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]*")
RESERVED = frozenset(
    {"all", "alive", "channel", "control", "estimate", "orchestrator", "paired", "plant", "recorder"}
    | {"rx", "truth", "tx"}
)
LARGEST_RANGE = 10_000

_NUMBERED = re.compile(r"(.*?)(\d+)")
_RANGE = re.compile(r"(?P<prefix>.*?)(?P<first>\d+)\.\.(?P<other>.*?)(?P<last>\d+)")


class NodeNameError(ValueError):
    """A name or range that cannot be; ``cure`` says what can."""

    def __init__(self, message: str, cure: str) -> None:
        super().__init__(message)
        self.cure = cure


def split_number(name: str) -> tuple[str, int | None]:
    """Return the family and the trailing number of a name: ``e12`` is number 12 of family ``e``."""
    match = _NUMBERED.fullmatch(name)
    return (match[1], int(match[2])) if match else (name, None)


def expand(text: str) -> list[str]:
    """Return the names that a range stands for, or the one name; raises `NodeNameError`."""
    if ".." not in text:
        return [_checked(text)]
    match = _RANGE.fullmatch(text)
    if match is None or match["prefix"] != match["other"]:
        raise NodeNameError(f"'{text}' is not a range", "write it as s1..s20: one prefix, two numbers")
    first, last = int(match["first"]), int(match["last"])
    if last < first:
        raise NodeNameError(
            f"the range '{text}' runs backwards", f"write {match['prefix']}{last}..{match['prefix']}{first}"
        )
    if match["first"] != str(first) or match["last"] != str(last):
        raise NodeNameError(
            f"the range '{text}' has leading zeros", "number nodes 1, 2, 3 without leading zeros"
        )
    if last - first >= LARGEST_RANGE:
        raise NodeNameError(
            f"the range '{text}' has {last - first + 1} nodes", f"the limit is {LARGEST_RANGE}"
        )
    return [_checked(f"{match['prefix']}{number}") for number in range(first, last + 1)]


def _checked(name: str) -> str:
    if not name:
        raise NodeNameError("a name is empty", "begin with a letter, for example s1")
    if not NODE_NAME.fullmatch(name):
        raise NodeNameError(
            f"'{name}' is not a name", "use letters, digits, '_' and '-', and begin with a letter"
        )
    if name.lower() in RESERVED:
        raise NodeNameError(f"'{name}' is a reserved word", f"call it '{name}1', for example")
    return name


def matches(pattern: str, name: str) -> bool:
    """Return whether a name fits a pattern: a name, a range, or text with ``*`` for any characters."""
    if ".." in pattern:
        try:
            return name in expand(pattern)
        except NodeNameError:
            return False
    return fnmatchcase(name, pattern.replace("[", "[[]").replace("?", "[?]"))


def select(pattern: str, names: Iterable[str]) -> list[str]:
    """Return the names that fit a pattern, in their order."""
    if ".." not in pattern and "*" not in pattern:
        return [name for name in names if name == pattern]
    if ".." in pattern:
        try:
            wanted = frozenset(expand(pattern))
        except NodeNameError:
            return []
        return [name for name in names if name in wanted]
    return [name for name in names if matches(pattern, name)]
