"""What is wrong with a topology: every problem at once, each with its place and its cure."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

from orchestrator.errors import InputError

PathKeys = tuple[str | int, ...]


@dataclass(frozen=True)
class Origin:
    """Where a value was written. ``line`` counts from 1; 0 for an override of the command line.

    ``directory`` is what relative paths written there refer to.
    """

    file: str
    line: int
    directory: Path


@dataclass(frozen=True)
class Problem:
    """One problem: where it is, what is wrong, and what would cure it (may be empty)."""

    file: str
    line: int
    path: str
    message: str
    cure: str = ""

    def __str__(self) -> str:
        place = f"{self.file}:{self.line}" if self.line else self.file
        where = f"{self.path}: " if self.path else ""
        cure = f"\n    {self.cure}" if self.cure else ""
        return f"{place}: {where}{self.message}{cure}"

    def as_json(self) -> dict[str, str | int]:
        """Return the problem for programs."""
        return asdict(self)


class TopologyError(InputError):
    """A topology cannot be run; ``problems`` lists everything that was found."""

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems = tuple(problems)
        super().__init__("\n".join(map(str, self.problems)))


class Problems:
    """Collects problems: the first at each path, and every message of a line once, whoever shares it."""

    def __init__(self) -> None:
        self._found: dict[tuple[str, int, str], Problem] = {}
        self._paths: set[str] = set()

    def add(self, origin: Origin, path: PathKeys | str, message: str, cure: str = "") -> None:
        """Note a problem."""
        spelled = path if isinstance(path, str) else spell(path)
        if spelled in self._paths:
            return
        if spelled:
            self._paths.add(spelled)
        self._found.setdefault(
            (origin.file, origin.line, message), Problem(origin.file, origin.line, spelled, message, cure)
        )

    def __iter__(self) -> Iterator[Problem]:
        return iter(sorted(self._found.values(), key=lambda problem: (problem.file, problem.line)))

    def __len__(self) -> int:
        return len(self._found)

    def stop_if_any(self) -> None:
        """Raise `TopologyError` when something was noted."""
        if self._found:
            raise TopologyError(self)


def spell(path: PathKeys) -> str:
    """Return a path as people write it and ``--set`` reads it: ``attacks[0].steps``."""
    text = ""
    for key in path:
        text += f"[{key}]" if isinstance(key, int) else f".{key}" if text else key
    return text


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return ``did you mean 'x'?``, or a list of what there is when nothing is near."""
    options = list(known)
    near = difflib.get_close_matches(word, options, n=1, cutoff=0.6)
    if near:
        return f"did you mean '{near[0]}'?"
    if not options:
        return ""
    shown = ", ".join(options[:12]) + (", ..." if len(options) > 12 else "")
    return f"there is: {shown}"
