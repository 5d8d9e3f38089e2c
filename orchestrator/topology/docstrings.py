"""Reads docstrings of the numpy convention: what a thing is, and what each of its parameters means."""

from __future__ import annotations

import inspect
import re
from dataclasses import dataclass, field

_HEADING = re.compile(r"^(\w[\w ]*)\n-{3,}$", re.MULTILINE)


@dataclass(frozen=True)
class Docstring:
    """A docstring in parts: its prose, and the meaning of each parameter."""

    prose: str = ""
    parameters: dict[str, str] = field(default_factory=dict)


def read_docstring(text: str) -> Docstring:
    """Return the parts of a docstring; of its sections, only the parameters."""
    parts = _HEADING.split(inspect.cleandoc(text))
    sections = dict(zip(parts[1::2], parts[2::2], strict=True))
    return Docstring(parts[0].strip(), _parameters(sections.get("Parameters", "")))


def docstring_of(kind: type) -> Docstring:
    """Return the docstring of a class; parameters that it does not tell are taken from its bases."""
    own = read_docstring(kind.__doc__ or "")
    inherited: dict[str, str] = {}
    for base in reversed(kind.__mro__[1:-1]):
        inherited |= read_docstring(base.__doc__ or "").parameters
    return Docstring(own.prose, {**inherited, **own.parameters})


def _parameters(section: str) -> dict[str, str]:
    meanings: dict[str, str] = {}
    names: list[str] = []
    for line in section.strip().splitlines():
        if line and not line[0].isspace():
            names = [name.strip() for name in line.partition(" : ")[0].split(",")]
            meanings.update(dict.fromkeys(names, ""))
        else:
            for name in names:
                meanings[name] = f"{meanings[name]} {line.strip()}".strip()
    return meanings


def markdown(prose: str) -> str:
    """Return prose as Markdown: literals between single backticks."""
    return re.sub(r"``(.+?)``", r"`\1`", prose, flags=re.DOTALL)
